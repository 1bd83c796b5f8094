"""Images of a recording that are annotated, compressed in memory."""

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass

from common.io.images import compress, decode_png16
from evaluation.annotations.marks import Mark, MarkView, digest_of
from people4d.errors import SourceError
from people4d.messages import F64, U16, CameraInfo, CompressedRgbdFrame, RgbdFrame
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import kind_of, open_source

IMAGES_MAX = 3000  # maximum number of images in memory, about 600 MB


@dataclass(frozen=True)
class AnnotatedImages:
    """The images of a recording that are annotated."""

    info: CameraInfo
    digest: str  # digest of the recording
    images: dict[int, CompressedRgbdFrame]  # images by their index in the recording
    unreadable: int  # number of images that cannot be read; they have no index

    def depth_mm(self, frame: int) -> U16:
        """Return the depth of an image."""
        return decode_png16(self.images[frame].depth_png)

    def points_m(
        self, frame: int, marks: Sequence[Mark], map_from_optical: F64
    ) -> list[F64 | None]:
        """Return the point of each mark in a map; None without depth."""
        view, depth_mm = MarkView(self.info, map_from_optical), self.depth_mm(frame)
        return [view.point_m(mark, depth_mm) for mark in marks]


def read_images(
    camera: CameraConfig, every: int, on_image: Callable[[int], None], only: Set[int] = frozenset()
) -> AnnotatedImages:
    """Read every n-th image of a recording, or only some by index; report the number so far.

    SourceError if no image can be read, or there are more than IMAGES_MAX.
    """
    if kind_of(camera.source) not in ("recording", "rosbag", "folder"):
        raise SourceError(f"{camera.source} is not a recording", "Record it: people4d record.")
    source = open_source(camera.source, camera.options)
    digest, images = "", dict[int, CompressedRgbdFrame]()
    captures = (item for item in source if isinstance(item, SourceFrame))
    for number, capture in enumerate(captures):
        digest = digest or digest_of(capture.rgb)
        if number % every or (only and number not in only):
            continue
        if len(images) == IMAGES_MAX:
            raise SourceError(
                f"{camera.source} has more than {IMAGES_MAX} images to annotate",
                "Annotate fewer: --every 10, or a part: people4d cut.",
            )
        frame = RgbdFrame(
            stamp_ns=capture.stamp_ns,
            sequence=number,
            camera=source.info.camera,
            rgb=capture.rgb,
            depth_mm=capture.depth_mm,
        )
        images[number] = compress(frame)
        on_image(len(images))
    source.close()
    unreadable = source.counters.get("bad_images", 0)
    if not images:
        raise SourceError(
            f"{camera.source} has no readable image ({unreadable} unreadable)",
            "Check it: people4d info.",
        )
    return AnnotatedImages(source.info, digest, images, unreadable)
