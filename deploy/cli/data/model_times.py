"""people4d models benchmark."""

import os
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
import typer

from common.config import load
from common.inference.engines import open_session
from common.inference.processor import CPU_INFO, DOT_PRODUCTS
from common.inference.session import Engine
from common.io.weights import ModelFile, find, folders, known_models
from deploy.cli.terminal import console, plain_table, progress
from people4d.errors import ConfigError, ModelError, People4dError
from services.detector.config import DetectorConfig
from services.detector.models.registry import MODELS, find_factory

IMAGE = (480, 640, 3)  # shape of the camera's image
ROUNDS = 5  # number of rounds, with alternating engines, so load affects all engines


def benchmark(
    seconds: Annotated[float, typer.Option(min=0.1, help="Time for each model and engine.")] = 3.0,
    threads: Annotated[int, typer.Option(min=1, help="Threads of one inference.")] = 1,
) -> None:
    """Measure the installed detection models with each engine; name the configured model's best."""
    file = os.environ.get("PEOPLE4D_CONFIG")
    configured = load(DetectorConfig, "detector", Path(file) if file else None).model
    present = [model for model in known_models().values() if model.kind in MODELS and _here(model)]
    runs: dict[tuple[str, Engine], Callable[[], object]] = {}
    failed: dict[str, str] = {}
    for model in present:
        for engine in get_args(Engine):
            try:
                runs[model.name, engine] = _detection(model, engine, threads)
            except (ConfigError, ModelError) as error:
                failed[f"{model.name}, {engine}"] = str(error)
    times_ms: dict[tuple[str, Engine], list[float]] = {key: [] for key in runs}
    with progress() as report:
        for number in range(ROUNDS * len(runs)):
            key = list(runs)[number % len(runs)]
            times_ms[key] += _times_ms(runs[key], seconds / ROUNDS)
            report("models", (number + 1) / (ROUNDS * len(runs)))
    _show(times_ms)
    console.print(f"\nInstructions that decide: {', '.join(instructions()) or 'none known'}.")
    console.print(recommendation(configured, times_ms), markup=False)
    for what, reason in failed.items():
        console.print(f"{what}: {reason}", markup=False, style="dim")


def _here(model: ModelFile) -> bool:
    try:
        return find(model, folders()).is_file()
    except ModelError:
        return False


def _detection(model: ModelFile, engine: Engine, threads: int) -> Callable[[], object]:
    session = open_session(find(model, folders()), threads, engine)
    detector = find_factory(model.kind)(session, DetectorConfig(), model.name)
    image = np.random.default_rng(0).integers(0, 255, IMAGE, np.uint8)
    return lambda: detector.detect(image)


def _times_ms(run: Callable[[], object], seconds: float) -> list[float]:
    times_ms, end_s = list[float](), time.perf_counter() + seconds
    while not times_ms or time.perf_counter() < end_s:
        begin_s = time.perf_counter()
        run()
        times_ms.append(1000 * (time.perf_counter() - begin_s))
    return times_ms


def _show(times_ms: dict[tuple[str, Engine], list[float]]) -> None:
    if not times_ms:
        raise People4dError("no detection model is installed", "See: people4d models.")
    medians = {key: statistics.median(times) for key, times in times_ms.items()}
    table = plain_table("model", "engine", ">median [ms]", ">10 to 90 %", ">images/s", "")
    for (name, engine), times in times_ms.items():
        low, high = np.percentile(times, (10, 90))
        median = medians[name, engine]
        best = median == min(value for (other, _), value in medians.items() if other == name)
        table.add_row(
            *(name, engine, f"{median:.1f}", f"{low:.1f} to {high:.1f}", f"{1000 / median:.0f}"),
            "fastest" if best else "",
        )
    console.print(table)


def instructions(file: Path = CPU_INFO) -> list[str]:
    """Return the processor's instructions that decide the time of a network, if it reports them."""
    try:
        words = file.read_text(encoding="utf-8", errors="replace").split()
    except OSError:
        return []
    return sorted({"avx2", *DOT_PRODUCTS} & set(words))


def recommendation(model: str, times_ms: Mapping[tuple[str, Engine], Sequence[float]]) -> str:
    """Return the setting of the fastest engine of a model."""
    medians = {
        engine: statistics.median(t) for (name, engine), t in times_ms.items() if name == model
    }
    if not medians:
        return f"The configured model {model} was not measured."
    engine = min(medians, key=medians.__getitem__)
    return f"Fastest engine of the configured model {model}: --set detector.engine={engine}"
