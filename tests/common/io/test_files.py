"""Files of others: no more than a limit, and nothing outside of their folder."""

import os
from pathlib import Path

import pytest

from common.io.files import inside, parse_toml, read_bytes, read_text, read_toml


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_bytes(path, 4)


def test_a_device_without_an_end_is_refused_at_the_limit() -> None:
    # Its reported size is 0.
    with pytest.raises(OSError, match="larger than 1000 bytes"):
        read_bytes(Path("/dev/zero"), 1000)


def test_pipe_is_read_to_its_end(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.write(writing, b"x = 1")
    os.close(writing)
    try:
        assert read_toml(Path(f"/dev/fd/{reading}")) == {"x": 1}
    finally:
        os.close(reading)


def test_a_sparse_file_of_a_terabyte_costs_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(OSError, match="larger"):
        read_text(path)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000,
        "a = " + "{a=" * 5000,
        "a = " + "9" * 5000,
        "a = 1\na = 2",
        "a = \xff\x00",
    ],
)
def test_what_is_no_toml_raises_nothing_but_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_toml(text)


@pytest.mark.parametrize("name", ["a.png", "rgb/1.png", "rgb/../a.png", "./a.png", "new.png"])
def test_names_inside_of_a_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "rgb").mkdir()
    (tmp_path / "a.png").touch()
    assert inside(tmp_path, name) == tmp_path / name


@pytest.mark.parametrize(
    "name", ["../a", "rgb/../../a", "/etc/hosts", "", " ", "a\0b", "out", "out/b", "up", "loop"]
)
def test_names_that_lead_out_of_a_folder(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    (folder / "rgb").mkdir(parents=True)
    (folder / "out").symlink_to("/etc")
    (folder / "up").symlink_to("..")
    (folder / "loop").symlink_to("loop")
    with pytest.raises(ValueError, match=r"leads out|expected the name|cannot be followed"):
        inside(folder, name)


def test_a_link_inside_of_the_folder_is_followed(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    (tmp_path / "b").symlink_to("a")
    (tmp_path / "here").symlink_to(".")
    assert inside(tmp_path / "here", "b").exists()
