"""Command `people4d compare`."""

from pathlib import Path
from typing import Annotated

import typer

from deploy.cli.terminal import plain_table, print_table, shown


def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a report of people4d evaluate.")],
    second: Annotated[Path, typer.Argument(help="Folder of another one, on the same recordings.")],
) -> None:
    """State by how much the second run is better or worse, with 95 % intervals.

    Both runs have the same ground truth. The intervals are of a bootstrap over parts of the
    recordings, paired by part.
    """
    from evaluation.compare import compare_reports  # noqa: PLC0415

    for names, figures in compare_reports(first, second).items():
        one, other = map(shown, names)
        title = f"{other} in {second} against {one} in {first}, {figures[0].parts} parts"
        table = plain_table("figure", ">first", ">second", "second is", title=title)
        for figure in figures:
            shape = figure.difference.figure
            values = (shape.form.format(value) for value in (figure.first, figure.second))
            table.add_row(shape.title, *values, figure.sentence)
        print_table(table)
