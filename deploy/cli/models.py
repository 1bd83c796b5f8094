"""people4d models."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.table import Table

from common.io.weights import ModelFile, find, folders, load_manifest, verify
from people4d.errors import ModelError

State = Literal["present", "verified", "any export", "altered", "absent"]
COLOURS: dict[State, str] = {
    "present": "green",
    "verified": "green",
    "any export": "green",
    "altered": "red",
    "absent": "yellow",
}


def models(
    verify_: Annotated[
        bool, typer.Option("--verify", help="Check the files; exit with 1 if one is altered.")
    ] = False,
) -> None:
    """List the models: whether they are here, their licence and input, and how to get them."""
    folders_ = folders()
    manifest = load_manifest()
    states = {name: state_of(model, folders_, verify_) for name, model in manifest.items()}
    console = Console(highlight=False, soft_wrap=True)
    table = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("model", "kind", "state", "licence", "input"):
        table.add_column(title, overflow="fold")
    for name, model in manifest.items():
        state = states[name]
        coloured = f"[{COLOURS[state]}]{state}[/]"
        table.add_row(f"[bold]{name}[/]", model.kind, coloured, model.licence, model.input)
    console.print(table)
    _print_sources(
        console, [m for name, m in manifest.items() if states[name] == "absent"], folders_
    )
    altered = [name for name, state in states.items() if state == "altered"]
    if altered:
        raise ModelError(
            f"{', '.join(altered)} differs from its checksum", "Remove it and get it again."
        )


def state_of(model: ModelFile, folders_: tuple[Path, ...], check: bool) -> State:
    """Return whether a model is here, and with `check` whether it is the right one."""
    try:
        path = find(model, folders_)
    except ModelError:
        return "absent"
    if not check:
        return "present"
    if not model.sha256:
        return "any export"
    try:
        verify(path, model.sha256)
    except ModelError:
        return "altered"
    return "verified"


def _print_sources(console: Console, absent: list[ModelFile], folders_: tuple[Path, ...]) -> None:
    if not absent:
        return
    console.print("\n[bold]How to get the others[/]")
    for model in absent:
        console.print(f"[bold]{model.name}[/] ({model.url or 'no page'})")
        console.print(f"  {model.get}", markup=False)
    console.print("\nFolders searched: " + ", ".join(map(str, folders_)), markup=False)
