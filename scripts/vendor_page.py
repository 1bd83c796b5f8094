"""Renew the libraries of the dashboard's page, and of its tests, from the npm registry.

    python -m scripts.vendor_page            # fetch the versions below
    python -m scripts.vendor_page --check    # only compare the files with their checksums

Each file is copied as published. To renew a library, change its version and checksum here; the
error of a first run shows the checksum of what came. It needs npm.
"""

import argparse
import hashlib
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "services" / "dashboard" / "page" / "vendor"
TESTS = ROOT / "tests" / "dashboard" / "vendor"
SUMS = "SHA256SUMS"


@dataclass(frozen=True)
class Library:
    """A package of npm, and the files of it that are used."""

    package: str  # name and version
    sha256: str  # of the package
    folder: Path
    files: dict[str, str]  # names here by paths in the package


LIBRARIES = (
    Library(  # MIT
        "three@0.178.0",
        "f9f1b23202c4697cbca9d97369559855517a7d0089f6c70f88014ce7deec474d",
        PAGE,
        {
            "build/three.module.min.js": "three.module.min.js",
            "build/three.core.min.js": "three.core.min.js",
            "LICENSE": "three.LICENSE",
        },
    ),
    Library(  # ISC
        "@msgpack/msgpack@3.1.3",
        "1fef5cd691fbe3ea2695ca12c8c01a5c2c50e7014486d32037e0242c1c24bd36",
        PAGE,
        {"dist.umd/msgpack.min.js": "msgpack.min.js", "LICENSE": "msgpack.LICENSE"},
    ),
    Library(  # MPL-2.0, not part of the package
        "axe-core@4.14.1",
        "e6b0ce02b84d892e2e33e403485e7f3d6c29e2be6df65daf44d89ba564139745",
        TESTS,
        {"axe.min.js": "axe.min.js", "LICENSE": "axe.LICENSE"},
    ),
)


def fetch(library: Library) -> None:
    """Copy the files of a library from its package; ValueError if that is another one."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["npm", "pack", "--silent", library.package]
        name = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
        package = Path(folder) / name.stdout.split()[-1]
        found = hashlib.sha256(package.read_bytes()).hexdigest()
        if found != library.sha256:
            raise ValueError(f"{library.package}: expected {library.sha256}, got {found}")
        library.folder.mkdir(parents=True, exist_ok=True)
        with tarfile.open(package) as archive:
            for path, target in library.files.items():
                content = archive.extractfile(f"package/{path}")
                assert content is not None
                (library.folder / target).write_bytes(content.read())


def checksums(folder: Path) -> str:
    """Return name and checksum of all files of a folder, as sha256sum writes them."""
    names = sorted(name for lib in LIBRARIES if lib.folder == folder for name in lib.files.values())
    sums = ((hashlib.sha256((folder / name).read_bytes()).hexdigest(), name) for name in names)
    return "".join(f"{checksum}  {name}\n" for checksum, name in sums)


def altered() -> Iterator[str]:
    """Yield the folders whose files are not those that were fetched."""
    for folder in (PAGE, TESTS):
        if (folder / SUMS).read_text("utf-8") != checksums(folder):
            yield str(folder.relative_to(ROOT))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare the files only")
    if not parser.parse_args().check:
        for library in LIBRARIES:
            fetch(library)
        for folder in (PAGE, TESTS):
            (folder / SUMS).write_text(checksums(folder), "utf-8")
    found = list(altered())
    for name in found:
        print(f"{name}: files differ from {SUMS}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
