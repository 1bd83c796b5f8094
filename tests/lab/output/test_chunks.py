"""Work in chunks that survives an interruption."""

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from lab.output.chunks import ChunkStore, digest_of, run_chunks
from people4d.errors import People4dError, SourceError


def write(folder: Path, piece: int) -> None:
    """Write a file with the id of the process."""
    (folder / str(piece)).write_text(str(os.getpid()))


def die(piece: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail(piece: int) -> None:
    raise SourceError("the disk is full", "Make room.")


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_chunk_runs_once(tmp_path: Path, jobs: int) -> None:
    assert sorted(run_chunks(partial(write, tmp_path), [3, 1, 4], jobs)) == [1, 3, 4]
    assert {path.name for path in tmp_path.iterdir()} == {"1", "3", "4"}
    here = {path.read_text() == str(os.getpid()) for path in tmp_path.iterdir()}
    assert here == {jobs == 1}


def test_error_of_a_chunk_is_raised() -> None:
    with pytest.raises(SourceError, match=r"the disk is full\. Make room"):
        list(run_chunks(fail, [0, 1], 2))


def test_killed_process_is_reported() -> None:
    with pytest.raises(People4dError, match="was killed"):
        list(run_chunks(die, [0, 1], 2))


def test_chunks_stay_for_the_same_work_only(tmp_path: Path) -> None:
    shelf = ChunkStore(tmp_path / "shelf", "a")
    assert shelf.missing(3) == [0, 1, 2]
    shelf.path(1).write_text("done")
    assert ChunkStore(tmp_path / "shelf", "a").missing(3) == [0, 2]
    assert ChunkStore(tmp_path / "shelf", "b").missing(3) == [0, 1, 2]
    shelf.remove()
    assert not (tmp_path / "shelf").exists()


def test_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SourceError, match="cannot be written"):
        ChunkStore(tmp_path / "file" / "shelf", "a")


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(SourceError, match="is in the way"):
        ChunkStore(tmp_path, "a")
    assert (tmp_path / "thesis.tex").exists()


def test_the_digest_changes_with_code_and_names(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("x = 1\n")
    before = digest_of(tmp_path)
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "a.pyc").write_text("compiled")
    assert digest_of(tmp_path) == before
    (tmp_path / "a.py").write_text("x = 2\n")
    changed = digest_of(tmp_path)
    assert changed != before
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert digest_of(tmp_path) != changed
