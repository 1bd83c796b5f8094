"""Command `people4d cameras`."""

import msgspec

from deploy.cli.options import Json
from deploy.cli.terminal import console, plain_table, print_json, print_table, shown
from services.camera.sources import camera_class, named_cameras


class CameraRow(msgspec.Struct, frozen=True, kw_only=True):
    """A camera connected to this machine."""

    source: str  # argument of people4d up --source
    model: str
    serial: str  # serial number; empty if unknown
    problem: str  # reason why it cannot be used, with the remedy; empty if usable


def cameras(json: Json = False) -> None:
    """Show the connected cameras, and the reasons why they cannot be used."""
    sources = sorted(named_cameras())
    rows = [
        CameraRow(source=source, model=one.model, serial=one.serial, problem=one.problem)
        for source in sources
        for one in camera_class(source).connected()
    ]
    if json:
        print_json(rows)
        return
    if not rows:
        console.print(f"no camera is plugged in. Sources by name: {', '.join(sources) or 'none'}")
        return
    table = plain_table("source", "camera", "serial", "problem")
    for row in rows:
        table.add_row(row.source, *map(shown, (row.model, row.serial, row.problem or "none")))
    print_table(table)
