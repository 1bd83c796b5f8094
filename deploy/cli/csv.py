"""people4d csv."""

from collections.abc import Iterable, Iterator
from heapq import merge
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from common.io.people_table import rows_of
from common.io.recording import Recording, open_recording
from common.metrics.alignment.truth_buffer import TruthBuffer
from deploy.tables import open_table
from people4d.errors import SourceError
from people4d.messages import Tracks, Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth


def csv(
    recording: Annotated[Path, typer.Argument(help="A people4d recording.")],
    table: Annotated[Path, typer.Argument(help="The table to write: .csv or .parquet.")],
    truth: Annotated[
        str, typer.Option(help="Truth of another file: recording, bag, CSV, MOT text or gt.npz.")
    ] = "",
    offset_s: Annotated[
        float, typer.Option("--offset", help="Seconds to add to the stamps of that truth.")
    ] = 0.0,
    at_tracks: Annotated[
        bool, typer.Option("--at-tracks", help="Truth interpolated to the stamps of the tracks.")
    ] = False,
) -> None:
    """Write truth and tracks of a recording to a table, one row for each person and stamp."""
    opened = open_recording(recording)
    source = open_truth(GtBridgeConfig(truth=truth)) if truth else _truth_of(opened)
    truths: Iterable[Truth] = _later(source, round(offset_s * 1e9))
    if at_tracks:
        truths = interpolated(truths, _tracks_of(opened))
    people: Iterable[Truth | Tracks] = merge(truths, _tracks_of(opened), key=_stamp_ns)
    rows = write(table, people)
    if not rows:
        found = ", ".join(opened.summary.topics) or "nothing"
        raise SourceError(
            f"{recording} has neither truth nor tracks",
            f"It holds {found}. Record with --topics people,truth.",
        )
    typer.echo(f"Wrote {rows} rows to {table}.")


def write(file: Path, messages: Iterable[Truth | Tracks]) -> int:
    """Write the people of messages to a table.

    Args:
        file: .csv or .parquet.
        messages: By rising stamp.

    Returns:
        Number of rows.

    Raises:
        ConfigError: The ending is another one, or what writes it is not installed.
        SourceError: The file cannot be written.
    """
    start_ns, count = None, 0
    with open_table(file) as put:
        for message in messages:
            for row in rows_of(message, message.stamp_ns if start_ns is None else start_ns):
                start_ns = message.stamp_ns if start_ns is None else start_ns
                put(row)
                count += 1
    return count


def interpolated(truths: Iterable[Truth], tracks: Iterable[Tracks]) -> Iterator[Truth]:
    """Yield the truth at the stamps of tracks, as far as it is known there.

    Args:
        truths: By rising stamp.
        tracks: By rising stamp.
    """
    buffer, waiting = TruthBuffer(), iter(truths)
    for message in tracks:
        while buffer.newest_ns is None or buffer.newest_ns < message.stamp_ns:
            truth = next(waiting, None)
            if truth is None:
                return
            buffer.add(truth)
        found = buffer.at(message.stamp_ns)
        if found is not None:
            yield found


def _tracks_of(recording: Recording) -> Iterator[Tracks]:
    return (m for _, m in recording.messages(Tracks) if isinstance(m, Tracks))


def _truth_of(recording: Recording) -> Iterator[Truth]:
    return (m for _, m in recording.messages(Truth) if isinstance(m, Truth))


def _later(truths: Iterable[Truth], offset_ns: int) -> Iterator[Truth]:
    return (msgspec.structs.replace(t, stamp_ns=t.stamp_ns + offset_ns) for t in truths)


def _stamp_ns(message: Truth | Tracks) -> int:
    return message.stamp_ns
