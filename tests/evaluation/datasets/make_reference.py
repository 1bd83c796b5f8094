"""Ask TrackEval for the figures of `people.drawn_boxes` in the layouts of data sets.

TrackEval reads the files that the miniatures write and our submission. From the root of the
repository, in an environment with the package (see tests/common/metrics/make_reference.py):

    .venv/bin/python -m tests.evaluation.datasets.make_reference FOLDER    # write the files
    /tmp/reference/bin/python tests/evaluation/datasets/make_reference.py FOLDER \
        > tests/evaluation/datasets/reference.json
"""

import json
import sys
from pathlib import Path
from typing import Any

FRAMES = 40
COMMON = {"USE_PARALLEL": False, "PRINT_CONFIG": False, "SKIP_SPLIT_FOL": True}


def write(folder: Path) -> None:
    """Write truth and submissions where TrackEval looks for them."""
    from evaluation.datasets import kitti, mot  # noqa: PLC0415
    from tests.evaluation.datasets import kitti as kitti_files  # noqa: PLC0415
    from tests.evaluation.datasets import mot as mot_files  # noqa: PLC0415
    from tests.evaluation.datasets import people  # noqa: PLC0415

    tracks = people.drawn_boxes().tracks
    mot_files.write_drawn(folder / "mot")
    kitti_files.write_drawn(folder / "kitti")
    seqmap = folder / "kitti" / "training" / "evaluate_tracking.seqmap.training"
    seqmap.write_text(f"0000 empty 000000 {FRAMES:06}\n")
    files = {"mot/tracks/ours/data/drawn.txt": mot, "kitti/tracks/ours/data/0000.txt": kitti}
    for path, module in files.items():
        (folder / path).parent.mkdir(parents=True)
        (folder / path).write_text(module.submission(tracks))


def datasets(folder: Path) -> dict[str, Any]:
    """Return TrackEval's readers, and a sequence, by the title of the data set."""
    from trackeval import datasets as theirs  # type: ignore[import-not-found] # noqa: PLC0415

    mot = COMMON | {
        "GT_FOLDER": str(folder / "mot" / "train"),
        "TRACKERS_FOLDER": str(folder / "mot" / "tracks"),
        "SEQ_INFO": {"drawn": FRAMES},
    }
    kitti = COMMON | {
        "GT_FOLDER": str(folder / "kitti" / "training"),
        "TRACKERS_FOLDER": str(folder / "kitti" / "tracks"),
        "CLASSES_TO_EVAL": ["pedestrian"],
    }
    names = ("MOT15", "MOT17", "MOT20")
    found = {n: (theirs.MotChallenge2DBox(mot | {"BENCHMARK": n}), "drawn") for n in names}
    return found | {"KITTI tracking": (theirs.Kitti2DBox(kitti), "0000")}


def figures(dataset: Any, sequence: str) -> dict[str, float]:
    """Return the figures of one sequence by our names."""
    from trackeval import metrics  # noqa: PLC0415

    raw = dataset.get_raw_seq_data("ours", sequence)
    data = dataset.get_preprocessed_seq_data(raw, "pedestrian")
    hota = metrics.HOTA().eval_sequence(data)
    clear = metrics.CLEAR({"PRINT_CONFIG": False}).eval_sequence(data)
    identity = metrics.Identity({"PRINT_CONFIG": False}).eval_sequence(data)
    found = {name: float(hota[key].mean()) for name, key in HOTA.items()}
    found |= {name: float(clear[key]) for name, key in CLEAR.items()}
    return found | {"idf1": float(identity["IDF1"])}


HOTA = {"hota": "HOTA", "det_a": "DetA", "ass_a": "AssA"}
CLEAR = {"mota": "MOTA", "misses": "CLR_FN", "false_alarms": "CLR_FP", "id_switches": "IDSW"}


def main() -> None:
    """Write the files, or print the figures as JSON if TrackEval is installed."""
    folder = Path(sys.argv[1])
    if not folder.exists():
        write(folder)
        return
    lines = [
        f"{json.dumps(name)}: {json.dumps(figures(*reader))}"
        for name, reader in datasets(folder).items()
    ]
    print("{", ",\n".join(lines), "}", sep="\n")


if __name__ == "__main__":
    main()
