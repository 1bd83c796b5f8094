"""Command `people4d csv`."""

import csv as csv_files
import importlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from heapq import merge
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec
import typer

from common.extras import need
from common.io.people_table import COLUMNS, NAMES, Cell, rows_of
from common.io.recording import Recording, open_recording
from common.metrics.alignment.truth_buffer import TruthBuffer
from deploy.cli.data.targets import check_folder
from people4d.errors import ConfigError, SourceError
from people4d.messages import Message, PersonSkeleton, Skeletons, Tracks, Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth

PARQUET = ".parquet"
BATCH = 50_000  # number of rows of a Parquet batch
M = TypeVar("M", bound=Message)
Row: TypeAlias = Mapping[str, Cell]


def csv(
    recording: Annotated[Path, typer.Argument(help="A people4d recording.")],
    table: Annotated[Path, typer.Argument(help="The table to write: .csv or .parquet.")],
    truth: Annotated[
        str,
        typer.Option(help="Ground truth from another file: recording, bag, CSV, MOT text, gt.npz."),
    ] = "",
    offset_s: Annotated[
        float, typer.Option("--offset", help="Seconds to add to the stamps of the ground truth.")
    ] = 0.0,
    at_tracks: Annotated[
        bool,
        typer.Option("--at-tracks", help="Interpolate ground truth to the stamps of the tracks."),
    ] = False,
) -> None:
    """Write ground truth and tracks of a recording to a table: a row for each person and stamp."""
    if table.suffix == PARQUET:
        need("Parquet", "parquet")
    opened = open_recording(recording)
    source = open_truth(GtBridgeConfig(truth=truth)) if truth else _of_kind(opened, Truth)
    offset_ns = round(offset_s * 1e9)
    truths: Iterable[Truth] = (
        msgspec.structs.replace(message, stamp_ns=message.stamp_ns + offset_ns)
        for message in source
    )
    if at_tracks:
        truths = interpolated(truths, _of_kind(opened, Tracks))
    people: Iterable[Truth | Tracks | Skeletons] = merge(  # skeletons before their tracks
        truths, _of_kind(opened, Skeletons), _of_kind(opened, Tracks), key=attrgetter("stamp_ns")
    )
    rows = write(table, people)
    if not rows:
        found = ", ".join(opened.summary.topics) or "nothing"
        raise SourceError(
            f"{recording} has neither truth nor tracks",
            f"It holds {found}. Record with --topics people,truth.",
        )
    typer.echo(f"Wrote {rows} rows to {table}.")


def write(file: Path, messages: Iterable[Truth | Tracks | Skeletons]) -> int:
    """Write the people of messages, by rising stamp, to a table; return the number of rows.

    Skeletons give the postures of the next tracks, if these have the same stamp and camera.
    """
    writers = {".csv": _open_csv, PARQUET: _open_parquet}
    if file.suffix not in writers:
        raise ConfigError(f"{file} has an unsupported format", f"Write {' or '.join(writers)}.")
    check_folder(file)
    start_ns, count = None, 0
    skeletons: Skeletons | None = None
    part = file.with_name(f".{file.name}.{os.getpid()}.part")  # renamed when complete
    try:
        with writers[file.suffix](part) as put:
            for message in messages:
                if isinstance(message, Skeletons):
                    skeletons = message
                    continue
                first_ns = message.stamp_ns if start_ns is None else start_ns
                for row in rows_of(message, first_ns, _at(skeletons, message)):
                    start_ns = first_ns
                    put(row)
                    count += 1
        if count:
            part.replace(file)
    except OSError as error:
        raise SourceError(f"table {file} cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            part.unlink()
    return count


def _at(skeletons: Skeletons | None, message: Truth | Tracks) -> dict[int, PersonSkeleton]:
    """Return the skeletons of a frame by identity; none for another frame or the truth."""
    if skeletons is None or not isinstance(message, Tracks):
        return {}
    if (skeletons.stamp_ns, skeletons.camera) != (message.stamp_ns, message.camera):
        return {}
    return {person.id: person for person in skeletons.people}


@contextmanager
def _open_csv(file: Path) -> Iterator[Callable[[Row], None]]:
    with file.open("w", newline="", encoding="utf-8") as text:
        writer = csv_files.DictWriter(text, NAMES)
        writer.writeheader()
        yield writer.writerow


@contextmanager
def _open_parquet(file: Path) -> Iterator[Callable[[Row], None]]:
    arrow: Any = importlib.import_module("pyarrow")
    parquet: Any = importlib.import_module("pyarrow.parquet")
    types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
    fields = [
        arrow.field(c.name, types[c.kind], c.optional, {"meaning": c.meaning}) for c in COLUMNS
    ]
    schema, rows = arrow.schema(fields), list[Row]()
    with parquet.ParquetWriter(file, schema) as writer:

        def put(row: Row | None) -> None:
            if row is not None:
                rows.append(row)
            if row is None or len(rows) >= BATCH:
                writer.write_table(arrow.Table.from_pylist(rows, schema=schema))
                rows.clear()

        yield put
        put(None)


def interpolated(truths: Iterable[Truth], tracks: Iterable[Tracks]) -> Iterator[Truth]:
    """Yield the truth interpolated to the stamps of tracks; both by rising stamp."""
    buffer, waiting = TruthBuffer(), iter(truths)
    for message in tracks:
        while buffer.newest_ns is None or buffer.newest_ns < message.stamp_ns:
            truth = next(waiting, None)
            if truth is None:
                return
            buffer.add_truth(truth)
        found = buffer.at(message.stamp_ns)
        if found is not None:
            yield found


def _of_kind(recording: Recording, kind: type[M]) -> Iterator[M]:
    return (message for _, message in recording.messages(kind) if isinstance(message, kind))
