"""Fuzzes one target with Atheris (libFuzzer for Python), within limits of memory and time.

It is a process of its own, for Atheris ends it: `python -m tests.fuzz.harness NAME CORPUS FOUND`,
then options of libFuzzer. What is raised and must not be is written to the folder FOUND, the
shortest input of each kind, and the fuzzing goes on; a crash of the process is written there too.
"""

import hashlib
import importlib
import os
import resource
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

HEADROOM_BYTES = 2**30  # of address space, beyond what is used when all is imported
SLOW_S = 2.0  # [s] of the processor for one input
SCRATCH = Path("/dev/shm")

# Packages, and modules of the standard library, whose branches the fuzzer sees.
INSTRUMENTED = (
    "common",
    "services",
    "deploy",
    "rosbags",
    "mcap",
    "tomllib",
    "configparser",
    "yaml",
)


class Judge:
    """Runs inputs and keeps those that end in what they must not.

    Args:
        read: Reads bytes.
        found: Folder for the inputs.
        allowed: What reading may raise.
    """

    def __init__(
        self, read: Callable[[bytes], None], found: Path, allowed: type[Exception]
    ) -> None:
        self._read = read
        self._found = found
        self._allowed = allowed

    def __call__(self, data: bytes) -> None:
        """Run one input."""
        start_s = time.process_time()
        try:
            self._read(data)
        except self._allowed as error:
            # A refusal for want of memory is no refusal.
            if isinstance(error.__cause__, MemoryError):
                self._keep(data, error.__cause__)
        except Exception as error:
            self._keep(data, error)
        if time.process_time() - start_s > SLOW_S:
            self._keep(data, TimeoutError())

    def _keep(self, data: bytes, error: BaseException) -> None:
        frames = traceback.extract_tb(error.__traceback__)[1:]
        place = f"{frames[-1].name}-{frames[-1].lineno}" if frames else "slow"
        text = f"{type(error).__name__}-{place}".replace("<", "").replace(">", "")
        path = self._found / text
        if not path.exists() or path.stat().st_size > len(data):
            path.write_bytes(data)
            lines = traceback.format_exception(error)
            path.with_suffix(".txt").write_text("".join(lines)[-4000:])


def limit_memory() -> None:
    """Let no input have more than the headroom, whatever it asks for."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + HEADROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def main() -> None:
    """Fuzz one target until libFuzzer ends the process."""
    import atheris  # noqa: PLC0415

    name, corpus, found, *options = sys.argv[1:]
    os.environ["OPENCV_LOG_LEVEL"] = "SILENT"
    with atheris.instrument_imports(include=list(INSTRUMENTED), enable_loader_override=False):
        target: Any = importlib.import_module("tests.fuzz.targets").TARGETS[name]
    allowed = importlib.import_module("common.errors").People4dError
    folder = tempfile.TemporaryDirectory(dir=SCRATCH if SCRATCH.is_dir() else None)
    place = Path(folder.name)
    with tempfile.TemporaryDirectory() as made:
        for seed in target.seeds(Path(made)):
            (Path(corpus) / hashlib.sha1(seed).hexdigest()).write_bytes(seed)
    judge = Judge(lambda data: target.read(data, place), Path(found), allowed)
    words = Path(found) / "words.dict"
    words.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words))
    options += [f"-max_len={target.max_bytes}", f"-dict={words}", f"-artifact_prefix={found}/"]
    atheris.Setup([sys.argv[0], corpus, *options], judge)
    limit_memory()
    atheris.Fuzz()


def _escaped(word: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word)


if __name__ == "__main__":
    main()
