"""The pipeline in a program of one's own: images in, people out, without processes or a network.

from people4d_robot import Intrinsics, Pipeline, mount

with Pipeline() as pipeline:
    lens = Intrinsics(fx=615.0, fy=615.0, cx=319.5, cy=239.5)
    pipeline.add_camera("front", lens, mount(z_m=1.2))
    people = pipeline.process(rgb, depth, stamp_s)
"""

from importlib.util import find_spec
from pathlib import Path


def check_names() -> None:
    """Check that no file of the program is imported in place of a package of the pipeline.

    Raises:
        ImportError: There is one.
    """
    for name in ("cameras", "common", "deploy", "evaluation", "lab", "services"):
        spec = find_spec(name)
        file = Path(spec.origin).resolve() if spec and spec.origin else None
        if file and file.parent.parent != Path(__file__).resolve().parent:
            raise ImportError(f"{file} hides the package {name} of people4d-robot: rename it")


check_names()

from deploy.program.images import mount  # noqa: E402 (only after the check)
from deploy.program.pipeline import Pipeline  # noqa: E402
from deploy.program.push import Camera  # noqa: E402
from services.camera.calibration import Intrinsics  # noqa: E402

__all__ = ["Camera", "Intrinsics", "Pipeline", "mount"]
