"""Command `people4d anonymise`."""

from pathlib import Path
from typing import Annotated

import typer

from deploy.anonymise.recordings import anonymise as write_copy
from deploy.cli.data.targets import Force, check_target
from deploy.cli.terminal import console


def anonymise(
    source: Annotated[Path, typer.Argument(help="A people4d recording.")],
    target: Annotated[Path, typer.Argument(help="The recording to write.")],
    colour: Annotated[
        bool, typer.Option("--colour/--no-colour", help="Heads in black, or no colour at all.")
    ] = True,
    force: Force = False,
) -> None:
    """Write a copy of a recording in which heads are blacked out, or which has no colour."""
    check_target(target, source, force)
    with console.status("Searching for heads ...") as status:
        counts = write_copy(
            source, target, colour, lambda share: status.update(f"Searching for heads: {share:.0%}")
        )
    typer.echo(
        f"Wrote {counts.frames} frames to {target}, {counts.covers} rectangles blacked out; "
        f"left out: {counts.left_out} messages with crops or embeddings, "
        f"{counts.bad_images} corrupt images."
    )
    if colour:
        typer.echo("Look through it before you give it away: a head may have been missed.")
