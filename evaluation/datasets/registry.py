"""The data sets by name."""

from typing import TYPE_CHECKING

from common import registry

if TYPE_CHECKING:
    from evaluation.datasets.dataset import Dataset

# Instances of `Dataset`, imported on use
DATASETS: dict[str, str] = {
    "mot15": "evaluation.datasets.mot:MOT15",
    "mot17": "evaluation.datasets.mot:MOT17",
    "mot20": "evaluation.datasets.mot:MOT20",
    "dancetrack": "evaluation.datasets.mot:DANCETRACK",
    "ai-city": "evaluation.datasets.aicity:AI_CITY",
    "eth-ucy": "evaluation.datasets.eth_ucy:ETH_UCY",
    "jrdb": "evaluation.datasets.jrdb:JRDB",
    "kitti": "evaluation.datasets.kitti:KITTI",
    "tum": "evaluation.datasets.robots.tum:TUM",
    "ktp": "evaluation.datasets.robots.ktp:KTP",
    "rimt": "evaluation.datasets.robots.rimt:RIMT",
    "tpt": "evaluation.datasets.robots.tpt:TPT",
}


def find_dataset(name: str) -> "Dataset":
    """Return the data set of a name; ConfigError if the name is unknown."""
    dataset: Dataset = registry.find("data set", DATASETS, name)
    return dataset
