"""Command `people4d settings`."""

from typing import Annotated

import typer

from deploy.cli.terminal import plain_table, print_table, shown
from deploy.settings import all_settings
from people4d.errors import ConfigError


def settings(
    name: Annotated[
        str, typer.Argument(help="First part of the names, such as tracker.strongsort3d.")
    ] = "",
) -> None:
    """Show all settings with units and defaults."""
    lists = all_settings()
    chosen = {
        heading: [row for row in rows if heading.startswith(name) or row.name.startswith(name)]
        for heading, rows in lists.items()
    }
    if not any(chosen.values()):
        raise ConfigError(f"no setting begins with {name!r}", f"Choose {', '.join(lists)}.")
    for heading, rows in chosen.items():
        table = plain_table("setting", "default", "meaning", title=heading)
        for row in rows:
            table.add_row(shown(row.name), shown(row.default), shown(row.meaning))
        if rows:
            print_table(table)
