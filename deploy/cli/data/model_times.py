"""Command `people4d models benchmark`."""

import json
import os
import re
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import typer

from common.config import load
from common.inference.engines import open_session
from common.inference.processor import decisive_instructions
from common.inference.session import Engine
from common.io.files import parse_toml, read_text, replace_file
from common.io.weights import ModelFile, find, folders, known_models
from deploy.cli.terminal import console, plain_table, progress
from deploy.launcher.plan import config_file
from people4d.errors import ConfigError, ModelError, People4dError
from services.detector.config import DetectorConfig
from services.detector.models.registry import MODELS, find_factory

IMAGE = (480, 640, 3)  # shape of the camera's image
# Table [detector] of a TOML file, and the line of its engine
TABLE = re.compile(r"^(\[detector\][^\n]*\n)((?:(?![ \t]*\[)[^\n]*\n?)*)", re.MULTILINE)
ENGINE = re.compile(r"""^([ \t]*engine[ \t]*=[ \t]*)(?:"[^"\n]*"|'[^'\n]*')""", re.MULTILINE)
ENGINE_VARIABLE = "PEOPLE4D_DETECTOR_ENGINE"  # it overrides the file
WRITE_BITS = 0o222  # write bits of a file's mode
ROUNDS = 5  # number of rounds, with alternating engines, so load affects all engines


def benchmark(
    seconds: Annotated[float, typer.Option(min=0.1, help="Time for each model and engine.")] = 3.0,
    threads: Annotated[int, typer.Option(min=1, help="Threads of one inference.")] = 1,
    config: Annotated[
        Path | None, typer.Option(help="TOML file of the settings, as in up --config.")
    ] = None,
    store: Annotated[
        bool, typer.Option("--store", help="Write the configured model's best engine to that file.")
    ] = False,
) -> None:
    """Measure the installed detection models with each engine; name the configured model's best."""
    file = config or config_file(os.environ)
    if store:
        check_replaceable(file)
    configured = load(DetectorConfig, "detector", file).model
    present = [model for model in known_models().values() if model.kind in MODELS and _here(model)]
    runs: dict[tuple[str, Engine], Callable[[], object]] = {}
    failed: dict[str, str] = {}
    for model in present:
        for engine in get_args(Engine):
            try:
                runs[model.name, engine] = _detection(model, engine, threads)
            except (ConfigError, ModelError) as error:
                failed[f"{model.name}, {engine}"] = str(error)
    for what, reason in failed.items():
        console.print(f"{what}: {reason}", markup=False, style="dim")
    if store and configured not in {name for name, _ in runs}:
        raise ConfigError(
            f"the configured model {configured} cannot be measured, so no engine is stored",
            "Choose an installed detection model: people4d models.",
        )
    times_ms: dict[tuple[str, Engine], list[float]] = {key: [] for key in runs}
    with progress() as report:
        for number in range(ROUNDS * len(runs)):
            key = list(runs)[number % len(runs)]
            times_ms[key] += _times_ms(runs[key], seconds / ROUNDS)
            report("models", (number + 1) / (ROUNDS * len(runs)))
    _show(times_ms)
    known = ", ".join(sorted(decisive_instructions()))
    console.print(f"\nInstructions that decide: {known or 'none known'}.")
    engine = fastest_engine(configured, times_ms)
    found = f"--set detector.engine={engine}" if engine else "not measured"
    console.print(f"Fastest engine of the configured model {configured}: {found}", markup=False)
    if store and engine:
        store_engine(file, engine)
        console.print(f"Stored in {file}.", markup=False)
        if os.environ.get(ENGINE_VARIABLE):
            console.print(f"{ENGINE_VARIABLE} overrides it.")


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


def fastest_engine(
    model: str, times_ms: Mapping[tuple[str, Engine], Sequence[float]]
) -> Engine | None:
    """Return the fastest engine of a model; None if it was not measured."""
    medians = {
        engine: statistics.median(t) for (name, engine), t in times_ms.items() if name == model
    }
    return min(medians, key=medians.__getitem__, default=None)


def check_replaceable(file: Path) -> None:
    """Check that an engine can be stored in a file; ConfigError for pipes and read-only files."""
    try:
        if not file.is_file():
            raise ValueError("it is not a regular file")
        # The mode too: root may write any file.
        if not file.stat().st_mode & WRITE_BITS or not os.access(file, os.W_OK):
            raise ValueError("it is read-only")
    except (OSError, ValueError) as error:
        hint = "Choose a writable file by --config."
        raise ConfigError(f"the engine cannot be stored in {file}: {error}", hint) from error


def store_engine(file: Path, engine: Engine) -> None:
    """Write the detector's engine to a configuration file; its other lines and comments stay.

    ConfigError as in `check_replaceable`, if the file cannot be read or written, or if its
    [detector] is written in another form.
    """
    check_replaceable(file)
    try:
        text = read_text(file)
        before = parse_toml(text)
        end = "\r\n" if "\r\n" in text else "\n"
        if not text.endswith("\n"):
            text += end
        if TABLE.search(text) is None:
            text += f"{end}[detector]{end}"
        found = TABLE.search(text)
        assert found
        body, count = ENGINE.subn(rf'\1"{engine}"', found[2], count=1)
        if not count:
            body = f'engine = "{engine}"{end}{body}'
        text = f"{text[: found.start(2)]}{body}{text[found.end(2) :]}"
        after = before | {"detector": {**before.get("detector", {}), "engine": engine}}
        if _comparable(parse_toml(text)) != _comparable(after):
            raise ValueError("its [detector] is no plain table")
        replace_file(file.resolve(), text.encode(), file.stat().st_mode & 0o777)
    except (OSError, ValueError, TypeError, RecursionError) as error:
        hint = f'Write it yourself, below [detector]: engine = "{engine}"'
        raise ConfigError(f"the engine cannot be stored in {file}: {error}", hint) from error


def _comparable(tables: dict[str, Any]) -> str:
    """Return tables as text, since NaN differs from itself."""
    return json.dumps(tables, sort_keys=True, default=repr)
