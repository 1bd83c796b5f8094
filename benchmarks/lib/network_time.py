"""Time of one network with one engine, in a process of its own: its instructions are set there."""

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import get_args

from common.inference.engines import PROBE_SIDES, open_session, probe_image
from common.inference.session import Engine

SECONDS = 2.0
VNNI = {"ONEDNN_MAX_CPU_ISA": "AVX512_CORE_VNNI"}  # what OpenVINO may use: no AMX


def network_ms(
    path: Path, engine: Engine, only_vnni: bool = False, sides: tuple[int, int] = PROBE_SIDES
) -> float:
    """Return the median time of one run on one thread [ms].

    Args:
        path: The network.
        engine: The engine.
        only_vnni: OpenVINO may use no AMX.
        sides: Height and width of the image [px], of a network that takes any size.
    """
    module = "benchmarks.lib.network_time"
    command = [sys.executable, "-m", module, str(path), engine, *map(str, sides)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", **(VNNI if only_vnni else {})}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def main() -> None:
    """Print the median."""
    path, engine = Path(sys.argv[1]), sys.argv[2]
    assert engine in get_args(Engine)
    session = open_session(path, 1, engine)  # type: ignore[arg-type]
    image = probe_image(session, (int(sys.argv[3]), int(sys.argv[4])))
    session.run(image)
    times_ms, end_s = list[float](), time.perf_counter() + SECONDS
    while time.perf_counter() < end_s:
        begin_s = time.perf_counter()
        session.run(image)
        times_ms.append(1000 * (time.perf_counter() - begin_s))
    print(statistics.median(times_ms))


if __name__ == "__main__":
    main()
