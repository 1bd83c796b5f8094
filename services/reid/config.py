"""Configuration of the re-identification service."""

from common.config import Config
from people4d.messages.base import PositiveInt


class ReidConfig(Config, frozen=True, kw_only=True):
    """Embedder and its network."""

    embedder: str = "histogram"  # one of EMBEDDERS, or "module:Class" called with this record
    # Network of "osnet": name in the manifest of models, or path of an .onnx file.
    model: str = "osnet-x0.25-msmt17"
    folder: str = ""  # folder that is searched first for named models; empty: none
    threads: PositiveInt = 1  # threads that one inference may use
