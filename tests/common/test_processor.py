from pathlib import Path

import pytest

from common.inference.processor import decisive_instructions, has_integer_dot_products


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("processor\t: 0\nflags\t\t: fpu avx2 avx512_vnni sse\n", True),
        ("flags\t\t: fpu avx2 avx_vnni\n", True),
        ("flags\t\t: fpu avx2 avx512f\nvmx flags\t: avx_vnni\n", False),
        ("processor\t: 0\nFeatures\t: fp asimd asimddp\n", True),  # Cortex-A76: Raspberry Pi 5
        ("processor\t: 0\nFeatures\t: fp asimd evtstrm crc32\n", False),  # Cortex-A72
        ("", False),
    ],
)
def test_dot_products_by_the_flags_of_the_processor(
    tmp_path: Path, text: str, expected: bool
) -> None:
    file = tmp_path / "cpuinfo"
    file.write_text(text)
    assert has_integer_dot_products(file) is expected


def test_processor_without_flags_has_no_dot_products(tmp_path: Path) -> None:
    assert not has_integer_dot_products(tmp_path / "absent")
    assert not decisive_instructions(tmp_path / "absent")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("flags\t\t: fpu amx_int8 avx2 avx512_vnni sse\n", {"amx_int8", "avx2", "avx512_vnni"}),
        ("Features\t: fp asimd asimddp\n", {"asimddp"}),
    ],
)
def test_decisive_instructions_are_of_the_processor(
    tmp_path: Path, text: str, expected: set[str]
) -> None:
    (tmp_path / "cpuinfo").write_text(text)
    assert decisive_instructions(tmp_path / "cpuinfo") == expected
