"""Fuzzing of targets with Atheris (libFuzzer for Python), within limits of memory and time.

Each target has a process of its own, because libFuzzer ends it. All are forked from one process
that has imported the instrumented modules. Inputs that raise a forbidden error are written to a
folder, the shortest of each kind, and fuzzing continues. Inputs that crash the process are written,
too.
"""

import hashlib
import importlib
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests import ROOT
from tests.fuzz.target import Target

HEADROOM_BYTES = 2**30  # address space beyond the use after all imports [bytes]
RSS_MB = 2048
SLOW_S = 2.0  # minimum processor time of a slow input [s]
# Maximum wall time of one input [s]; the process may be stopped meanwhile
TIMEOUT_S = 1200
NICENESS = 3
SCRATCH = Path("/dev/shm")
LOG = "log.txt"

# Packages, and modules of the standard library, whose branches count as coverage.
INSTRUMENTED = (
    "people4d",
    "common",
    "services",
    "lab",
    "deploy",
    "rosbags",
    "mcap",
    "tomllib",
    "configparser",
    "yaml",
)


def compiled_modules() -> list[str]:
    """Return the modules with functions compiled by Numba, which instrumentation would break."""
    files = (file for folder in INSTRUMENTED for file in (ROOT / folder).rglob("*.py"))
    return [
        ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for file in files
        if "@compiled" in file.read_text(encoding="utf-8")
    ]


def load() -> dict[str, Target]:
    """Import all targets so that their coverage is measured; call it before they are imported."""
    import atheris  # noqa: PLC0415

    if "people4d.codec" in sys.modules:
        raise RuntimeError("the targets are imported already: their coverage would not be measured")
    os.environ["OPENCV_LOG_LEVEL"] = "SILENT"
    with atheris.instrument_imports(
        include=list(INSTRUMENTED), exclude=compiled_modules(), enable_loader_override=False
    ):
        groups = list(importlib.import_module("tests.fuzz.targets").groups())
    return {name: target for group in groups for name, target in group.items()}


def fuzz(target: Target, corpus: Path, found: Path, seconds: float) -> float:
    """Fuzz a target in a process of its own.

    Args:
        target: The target.
        corpus: Folder of inputs to begin with and to add to.
        found: Folder for findings and the log of libFuzzer (LOG).
        seconds: Processor time, so that a busy machine does not shorten the fuzzing.

    Returns:
        Used processor time [s].
    """
    corpus.mkdir(parents=True, exist_ok=True)
    found.mkdir(parents=True, exist_ok=True)
    scratch = SCRATCH if SCRATCH.is_dir() else None
    with tempfile.TemporaryDirectory(dir=scratch, prefix="fuzz-") as folder:
        child = os.fork()
        if not child:
            try:
                _child(target, (corpus, found, Path(folder)), seconds)
            finally:
                os._exit(1)
        _, _, usage = os.wait4(child, 0)
    return usage.ru_utime + usage.ru_stime


class InputRunner:
    """Runs inputs and saves inputs that raise other errors than allowed."""

    def __init__(
        self, read: Callable[[bytes], None], found: Path, allowed: type[Exception], seconds: float
    ) -> None:
        self._read = read
        self._found = found
        self._allowed = allowed
        self._end_s = time.process_time() + seconds

    def __call__(self, data: bytes) -> None:
        """Run one input."""
        start_s = time.process_time()
        try:
            self._read(data)
        except self._allowed as error:
            # Running out of memory is no refusal.
            if isinstance(error.__cause__, MemoryError):
                self._save(data, error.__cause__)
        except Exception as error:
            self._save(data, error)
        now_s = time.process_time()
        if now_s - start_s > SLOW_S:
            self._save(data, TimeoutError())
        if now_s > self._end_s:
            os.kill(os.getpid(), signal.SIGUSR1)

    def _save(self, data: bytes, error: BaseException) -> None:
        frames = traceback.extract_tb(error.__traceback__)[1:]
        line = f"{frames[-1].name}-{frames[-1].lineno}" if frames else "slow"
        text = f"{type(error).__name__}-{line}".replace("<", "").replace(">", "")
        path = self._found / text
        if not path.exists() or path.stat().st_size > len(data):
            path.write_bytes(data)
            lines = traceback.format_exception(error)
            path.with_suffix(".txt").write_text("".join(lines)[-4000:])


def _child(target: Target, folders: tuple[Path, Path, Path], seconds: float) -> None:
    import atheris  # noqa: PLC0415

    corpus, found, scratch = folders
    os.nice(NICENESS)
    log = (found / LOG).open("w")
    os.dup2(log.fileno(), sys.stderr.fileno())
    allowed: Any = importlib.import_module("people4d.errors").People4dError
    with tempfile.TemporaryDirectory() as made:
        for seed in target.seeds(Path(made)):
            (corpus / hashlib.sha1(seed).hexdigest()).write_bytes(seed)
    options = [
        f"-max_len={target.max_bytes}",
        f"-artifact_prefix={found}/",
        f"-rss_limit_mb={RSS_MB}",
        f"-timeout={TIMEOUT_S}",
        "-print_final_stats=1",
        "-report_slow_units=1000",  # by the wall clock; InputRunner counts processor time
        "-close_fd_mask=3",
    ]
    if target.words:
        words = found / "words.dict"
        words.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words))
        options.append(f"-dict={words}")
    runner = InputRunner(lambda data: target.read(data, scratch), found, allowed, seconds)
    atheris.Setup([sys.argv[0], str(corpus), *options], runner)
    _limit_memory()
    atheris.Fuzz()


def _limit_memory() -> None:
    """Limit the memory of one input to the headroom."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + HEADROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _escaped(word: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word)
