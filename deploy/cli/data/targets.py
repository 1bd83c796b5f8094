"""Output file of a command, with the option --force."""

from pathlib import Path
from typing import Annotated

import typer

from people4d.errors import ConfigError

Force = Annotated[bool, typer.Option("--force", help="Overwrite the file.")]


def check_target(target: Path, source: Path | None, force: bool) -> None:
    """Check that a file may be written; ConfigError if it is the input `source`, or exists."""
    if source and target.exists() and target.samefile(source):
        raise ConfigError(f"{target} is the recording itself", "Name another file.")
    check_folder(target)
    if target.exists() and not force:
        raise ConfigError(f"{target} exists", "Name another file, or overwrite it with --force.")


def check_folder(target: Path) -> None:
    """Check that the folder of an output file exists; ConfigError otherwise."""
    if not target.parent.is_dir():
        raise ConfigError(f"folder {target.parent} does not exist", "Create it, or check the path.")
