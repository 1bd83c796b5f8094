"""Command `people4d models`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from common.io.weights import ModelFile, find, folders, known_models, verify
from deploy.cli.data.model_add import add
from deploy.cli.data.model_times import benchmark
from deploy.cli.data.quantize import quantize
from deploy.cli.terminal import Command, CommandGroup, console, plain_table
from people4d.errors import ModelError

State = Literal["present", "verified", "any export", "altered", "absent"]
Verify = Annotated[
    bool,
    typer.Option(
        "--verify", help="Compare files with known checksums; exit with 1 if one differs."
    ),
]
COLOURS = {"altered": "red", "absent": "yellow"}  # colours of states; others are green


def models(context: typer.Context, verify_: Verify = False) -> None:
    """List the models: presence, licence, input and source; add or quantize one, measure all."""
    if not context.invoked_subcommand:
        list_(verify_)


def list_(verify_: Verify = False) -> None:
    """List the models: presence, licence, input and source."""
    folders_ = folders()
    manifest = known_models()
    states = {name: state_of(model, folders_, verify_) for name, model in manifest.items()}
    table = plain_table("model", "kind", "state", "licence", "input", overflow="fold")
    for name, model in manifest.items():
        state = states[name]
        coloured = f"[{COLOURS.get(state, 'green')}]{state}[/]"
        table.add_row(f"[bold]{name}[/]", model.kind, coloured, model.licence, model.input)
    console.print(table)
    absent = [model for name, model in manifest.items() if states[name] == "absent"]
    if absent:
        console.print("\n[bold]How to get the others[/]")
        for model in absent:
            console.print(f"[bold]{model.name}[/] ({model.url or 'no page'})")
            console.print(f"  {model.get}", markup=False)
        console.print("\nFolders searched: " + ", ".join(map(str, folders_)), markup=False)
    altered = [name for name, state in states.items() if state == "altered"]
    if altered:
        raise ModelError(
            f"{', '.join(altered)} differs from its checksum", "Remove it and get it again."
        )


def state_of(model: ModelFile, folders_: tuple[Path, ...], check: bool) -> State:
    """Return the presence of a model, and with `check` the state of its file."""
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


def group() -> typer.Typer:
    """Return the command with its sub-commands."""
    app = typer.Typer(cls=CommandGroup, add_completion=False, pretty_exceptions_enable=False)
    app.callback(invoke_without_command=True)(models)
    app.command("list", cls=Command)(list_)
    for command in (add, quantize, benchmark):
        app.command(cls=Command)(command)
    return app
