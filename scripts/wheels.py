"""Check that each pinned dependency has a wheel for 64-bit ARM Linux.

    python -m scripts.wheels [LOCK ...]     # default: all requirements*.lock

Only indexes are read and nothing is installed. The exit status is 1 if a wheel is missing that is
not in MISSING, or if one of MISSING has come to exist.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
GLIBC = ("2_17", "2_24", "2_26", "2_27", "2_28", "2_31", "2_34", "2_35")  # up to Ubuntu 22.04's
MISSING = {"cyclonedds", "pyrealsense2"}  # optional: the extras dds and realsense need them
REQUIREMENT = re.compile(r"^[^\s#-].*?(?:\\\n.*?)*[^\\]$", re.MULTILINE)


def missing_wheels(lock: Path) -> set[str]:
    """Return the names of the requirements of a lock file without a wheel for ARM64."""
    requirements = REQUIREMENT.findall(lock.read_text(encoding="utf-8"))
    missing: set[str] = set()
    while name := first_missing([line for line in requirements if name_of(line) not in missing]):
        missing.add(name)
    return missing


def first_missing(requirements: list[str]) -> str:
    """Return the name of the first requirement without a wheel; empty if all have one.

    Raises:
        RuntimeError: pip failed for another reason.
    """
    with tempfile.TemporaryDirectory() as folder:
        lock = Path(folder) / "requirements.txt"
        lock.write_text("\n".join(requirements), encoding="utf-8")
        platforms = [f"--platform=manylinux_{glibc}_aarch64" for glibc in GLIBC]
        done = subprocess.run(
            [
                *(sys.executable, "-m", "pip", "install", "--dry-run", "--no-deps", "--target"),
                *(f"{folder}/none", "--only-binary=:all:", "--python-version=3.11.9", *platforms),
                *("--implementation=cp", "--require-hashes", "--quiet", "-r", str(lock)),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode == 0:
        return ""
    found = re.search(r"No matching distribution found for ([\w.-]+)==", done.stderr)
    if found is None:
        raise RuntimeError(done.stderr.strip()[-2000:])
    return found[1]


def name_of(requirement: str) -> str:
    """Return the name of a pinned requirement."""
    return requirement.partition("==")[0].strip()


def main(arguments: list[str]) -> int:
    """Check lock files and print what is missing; return the exit status."""
    locks = [Path(name) for name in arguments] or sorted(REPOSITORY.glob("requirements*.lock"))
    missing: set[str] = set()
    for lock in locks:
        found = missing_wheels(lock)
        missing |= found
        print(f"{lock.name}: {', '.join(sorted(found)) or 'all wheels exist'}")
    unexpected = missing - MISSING if arguments else missing ^ MISSING
    if unexpected:
        print(f"not as expected: {', '.join(sorted(unexpected))}")
    return 1 if unexpected else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
