"""people4d run."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

import services
from people4d.errors import People4dError

CONTEXT_SETTINGS = {"allow_extra_args": True, "ignore_unknown_options": True}


def run(
    context: typer.Context,
    service: Annotated[str, typer.Argument(help="Name of the service, for example detector.")],
) -> None:
    """Run one service in this terminal: python -m services.SERVICE with all further arguments."""
    if not service.isidentifier() or not find_spec(f"services.{service}"):
        folders = sorted(Path(services.__path__[0]).glob("*/__main__.py"))
        names = ", ".join(file.parent.name for file in folders)
        raise People4dError(f"there is no service {service!r}", f"Services are {names}.")
    os.execv(sys.executable, [sys.executable, "-m", f"services.{service}", *context.args])
