"""Configuration of the re-identification service."""

from common.config import Config
from common.inference.session import Engine
from people4d.messages.base import PositiveInt

# Default network of each embedder that needs one
NETWORKS = {"appearance": "appearance-lab", "osnet": "osnet-x0.25-msmt17"}


class ReidConfig(Config, frozen=True, kw_only=True):
    """Embedder and its network."""

    embedder: str = "appearance"  # one of EMBEDDERS, or "module:Class" called with this record
    # Network: name in the manifest of models, or path of an .onnx file; empty: the embedder's own
    model: str = ""
    folder: str = ""  # folder that is searched first for named models; empty: none
    engine: Engine = "onnxruntime"  # "openvino": faster on Intel processors; requires an extra
    threads: PositiveInt = 1  # maximum number of threads of one inference

    @property
    def network(self) -> str:
        """Name or path of the embedder's network; empty if it needs none."""
        return self.model or NETWORKS.get(self.embedder, "")
