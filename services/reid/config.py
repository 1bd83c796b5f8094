"""Configuration of the re-identification service."""

import msgspec


class ReidConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Which embedder runs, and how."""

    embedder: str = "histogram"  # one of EMBEDDERS, or "module:Class" called with this record
    # Network of "osnet": name in the manifest of models, or path of an .onnx file.
    model: str = "osnet-x0.25-msmt17"
    folder: str = ""  # folder that is searched first for named models; empty: none
    threads: int = 1  # threads that one inference may use

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        if self.threads < 1:
            raise ValueError(f"threads: expected at least 1, got {self.threads}")
