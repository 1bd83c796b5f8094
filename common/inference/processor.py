"""Instructions of this computer's processor."""

from functools import cache
from pathlib import Path

CPU_INFO = Path("/proc/cpuinfo")
# Names of instructions of 8-bit dot products in Linux, on x86-64 and on ARM64
DOT_PRODUCTS = {"avx512_vnni", "avx_vnni", "amx_int8", "asimddp"}
DECISIVE = {"avx2", *DOT_PRODUCTS}  # instructions that decide the time of a network


@cache
def decisive_instructions(file: Path = CPU_INFO) -> frozenset[str]:
    """Return which of DECISIVE the processor has; none if the system does not report them.

    Args:
        file: Flags of the processor in the format of Linux.
    """
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return frozenset()
    lines = (line for line in text.splitlines() if line.startswith(("flags", "Features")))
    flags = (line.partition(":")[2] for line in lines)
    return frozenset(DECISIVE.intersection(next(flags, "").split()))


def has_integer_dot_products(file: Path = CPU_INFO) -> bool:
    """Check for instructions of 8-bit dot products (VNNI, AMX, SDOT of ARM).

    With VNNI, int8 networks take less than half the time of float32, otherwise nearly the same. On
    ARM64 the times are not measured.
    """
    return not DOT_PRODUCTS.isdisjoint(decisive_instructions(file))
