"""Command `people4d info`."""

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.table import Table

from common.calibration.transforms_file import MAP
from common.diagnosis.camera_checks import off_centre
from common.io.recording import open_recording
from deploy.cli.options import Json
from deploy.cli.terminal import console, plain_table, print_json, shown
from lab.depth.metadata import SimulationMetadata, read_metadata
from services.camera.describe import Description, describe


class Info(Description, frozen=True, kw_only=True):
    """Contents of a recording, with the simulation of a simulated one."""

    lab: SimulationMetadata | None = None  # metadata of the simulation; None: no simulation


def info(
    recording: Annotated[Path, typer.Argument(help="Recording, ROS bag or folder of images.")],
    json: Json = False,
) -> None:
    """Show the content of a recording, bag or folder; exit with 1 if it cannot be played."""
    found = read_info(recording)
    if json:
        print_json(found)
    else:
        _show(found)
    if found.problem:
        raise typer.Exit(1)


def _show(found: Info) -> None:
    console.print(_facts(found))
    if found.topics:
        table = plain_table("topic", "type", ">messages")
        for topic in found.topics:
            table.add_row(shown(topic.name), shown(topic.type), str(topic.count))
        console.print(table)


def read_info(path: Path) -> Info:
    """Describe a recording, a ROS bag or a folder of images."""
    description = describe(path)
    lab = None
    if description.kind == "recording" and description.calibration:
        lab = read_metadata(open_recording(path))
    return Info(**msgspec.structs.asdict(description), lab=lab)


def _facts(description: Info) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    rate_hz = (description.frames - 1) / description.duration_s if description.duration_s else 0.0
    rate = f", {rate_hz:.1f} a second" if rate_hz > 0 else ""
    rows = {
        "path": description.path,
        "kind": description.kind,
        "duration": f"{description.duration_s:.1f} s",
        "frames": f"{description.frames}{rate}" if description.frames else "none",
        "camera": camera_text(description),
        "mounted in": description.mounted_in or "unknown: set camera.mount_xyz_m, mount_rpy_rad",
        "odometry": odometry_text(description),
        "truth": "yes" if description.has_truth else "no",
        "can be played": _playable(description),
    }
    if description.lab:
        rows["simulated"] = _simulated(description.lab)
    for name, value in rows.items():
        table.add_row(f"[bold]{name}[/]", shown(value))
    return table


def _simulated(note: SimulationMetadata) -> str:
    depth = "with the sensor's errors"
    if note.depth == "clean":
        depth = "stored clean, the sensor's errors are added on playing"
    return f"scenario {note.scenario}, seed {note.seed}; depth {depth}"


def odometry_text(description: Description) -> str:
    """Describe odometry, and the setting that uses it."""
    frame = description.unlinked_odometry
    if frame and description.mounted_in == MAP:
        return f"yes, in {frame}, unused: the camera is mounted in the map, as are the people"
    if frame and description.mounted_in:
        return (
            f"yes, in {frame}, which nothing links to the map: people are given relative to the "
            f"camera unless --set tracker.frame_id={frame}"
        )
    return "yes" if description.has_odometry else "no"


def _playable(description: Description) -> str:
    if description.problem:
        return f"no: {description.problem}"
    return "up to where it is cut short" if description.cut_short else "yes"


def camera_text(description: Description) -> str:
    """Describe size and lens of the camera, and changes of its images."""
    info = description.calibration
    if not info:
        return "unknown"
    moved = ", depth is moved into the view of colour" if description.registered else ""
    if description.turned_deg:
        moved += f", images are turned by {description.turned_deg} degrees to be upright"
    if off := off_centre(info):
        moved += f"; {off}: is it of another image size?"
    return (
        f"{info.width}x{info.height}, fx {info.fx:.1f} fy {info.fy:.1f} cx {info.cx:.1f} "
        f"cy {info.cy:.1f}, distortion {info.distortion_model}{moved}"
    )
