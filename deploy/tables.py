"""Tables of people as files: CSV always, Parquet where pyarrow is installed."""

import csv
import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from common.io.people_table import COLUMNS, NAMES, Cell
from people4d.errors import ConfigError, SourceError

BATCH = 50_000  # rows that are written to Parquet at once
Row: TypeAlias = Mapping[str, Cell]


@contextmanager
def open_table(file: Path) -> Iterator[Callable[[Row], None]]:
    """Open a table and give what appends a row; it is whole at the end of the block.

    Args:
        file: .csv or .parquet; its folder is made, an existing file is replaced.

    Raises:
        ConfigError: The ending is another one, or pyarrow is not installed.
        SourceError: The file cannot be written.
    """
    kinds = {".csv": _open_csv, ".parquet": _open_parquet}
    if file.suffix not in kinds:
        raise ConfigError(f"{file} is of no known kind", f"Write {' or '.join(kinds)}.")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with kinds[file.suffix](file) as put:
            yield put
    except OSError as error:
        raise SourceError(f"table {file} cannot be written: {error.strerror or error}") from error


@contextmanager
def _open_csv(file: Path) -> Iterator[Callable[[Row], None]]:
    with file.open("w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, NAMES)
        writer.writeheader()
        yield writer.writerow


@contextmanager
def _open_parquet(file: Path) -> Iterator[Callable[[Row], None]]:
    try:
        arrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise ConfigError(
            "Parquet needs pyarrow, which is not installed",
            "pip install 'people4d[parquet]', or write .csv.",
        ) from error
    types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
    fields = [
        arrow.field(c.name, types[c.kind], c.optional, {"meaning": c.meaning}) for c in COLUMNS
    ]
    schema, rows = arrow.schema(fields), list[Row]()
    with parquet.ParquetWriter(file, schema) as writer:

        def flush() -> None:
            writer.write_table(arrow.Table.from_pylist(rows, schema=schema))
            rows.clear()

        def put(row: Row) -> None:
            rows.append(row)
            if len(rows) >= BATCH:
                flush()

        yield put
        flush()
