"""Methods that are compared on annotated real people, and the splits of the recording."""

from dataclasses import dataclass
from pathlib import Path

from evaluation.methods import Method, read_method

ROOT = Path(__file__).resolve().parents[3]
MARKS = ROOT / "benchmarks" / "real_people_marks"
HALF_FRAME = 54  # first frame of the test split
HALVES = {"first half": range(HALF_FRAME), "second half": range(HALF_FRAME, 10_000)}
DEFAULT = "MoveNet, appearance (default)"


@dataclass(frozen=True)
class Variant:
    """One method under test."""

    name: str
    preset: str
    settings: tuple[str, ...] = ()
    detector: str = ""  # name of its detections if other packages use them

    def method(self) -> Method:
        """Return its configuration."""
        return read_method(self.preset, self.settings)


def variants(shared: Path) -> list[Variant]:
    """Return the methods."""
    folder = shared / "data" / "models"
    pose, seg = (folder / f"yolov8n-{kind}_640.onnx" for kind in ("pose", "seg"))
    yolo, yolo_seg = (f"detector.model={path}" for path in (pose, seg))
    osnet = f"reid.model={folder / 'osnet_x0_25_msmt17.onnx'}"
    embedder = "reid.embedder=osnet"
    best = [
        Variant(DEFAULT, "best", (), "MoveNet"),
        Variant("MoveNet, histogram", "best", ("reid.embedder=histogram",)),
        Variant("MoveNet, OSNet", "best", (embedder, osnet)),
        Variant("YOLOv8n-pose, appearance", "best", (yolo,), "YOLOv8n-pose"),
        Variant("YOLOv8n-pose, histogram", "best", (yolo, "reid.embedder=histogram")),
        Variant("YOLOv8n-pose, OSNet", "best", (yolo, embedder, osnet)),
    ]
    published = {
        "seg-sort": (yolo_seg,),
        "seg-strongsort": (yolo_seg, osnet),
        "pose-strongsort": (yolo, osnet),
        **dict.fromkeys(("seg-sort-movenet", "seg-strongsort-movenet"), ()),
        "pose-strongsort-movenet": (),
        **dict.fromkeys(("image-sort", "image-sort-dynamic"), (yolo,)),
    }
    presets = [Variant(f"preset {name}", name, settings) for name, settings in published.items()]
    return [*best, *presets]
