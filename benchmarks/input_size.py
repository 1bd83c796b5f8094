"""Smaller input of MoveNet while all people are near: time, and what it loses.

The choice of the size is that of the detector (`near_input`, docs/methods/models.md). Frames are
those of the lab, of scenes that chose no constant, and the marked real ones of filinha. Size and
least height were chosen on the first half of filinha and on other scenes of the lab.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.lib.network_time import network_ms
from benchmarks.lib.table import markdown, spread, write
from benchmarks.quantization import ENGINES
from benchmarks.real_inputs import ROOT
from benchmarks.score_calibration import matches_of_marks, real_frames
from common.io.weights import REPOSITORY
from evaluation.quantization.accuracy import compare, found_by
from evaluation.recordings.rendered import HELD_OUT, render
from services.detector.build import build
from services.detector.config import DetectorConfig, ModelSettings, NearInputConfig
from services.detector.input_size import InputSizeChoice
from services.detector.models.registry import load_model

ROUNDS = 3
NEAR = NearInputConfig(height=160, width=224)
FULL_SIDES, NEAR_SIDES = (256, 320), (NEAR.height, NEAR.width)
NEAR_SCENES = (
    ("gait_hand", 31, range(0, 240, 12)),
    ("gait_turn", 32, range(0, 240, 12)),
    ("facing", 33, range(0, 240, 12)),
)
TIMES = ("network", "engine", "256x320 ms", "160x224 ms", "near scenes ms", "of float at 256x320")
LOSSES = ("frames", "frames at 160x224", "people found", "recall", "position", "yaw")


def times() -> Iterator[list[str]]:
    """Yield a row for each network and engine."""
    taken_ms: dict[tuple[str, str, tuple[int, int]], list[float]] = {}
    networks = ("movenet-multipose", "movenet-multipose-int8")
    for _ in range(ROUNDS):
        for title, engine, only_vnni in ENGINES:
            for name in networks:
                for sides in (FULL_SIDES, NEAR_SIDES):
                    path = REPOSITORY / "models" / f"{name}.onnx"
                    found = network_ms(path, engine, only_vnni, sides)
                    taken_ms.setdefault((name, title, sides), []).append(found)
    for name in networks:
        for title, _, _ in ENGINES:
            full_ms, near_ms = (taken_ms[name, title, s] for s in (FULL_SIDES, NEAR_SIDES))
            every = NEAR.full_every
            mixed_ms = [
                (full + (every - 1) * near) / every
                for full, near in zip(full_ms, near_ms, strict=True)
            ]
            float_ms = taken_ms[networks[0], title, FULL_SIDES]
            yield [
                name,
                title,
                *(spread(values, "{:.1f}") for values in (full_ms, near_ms, mixed_ms)),
                f"{min(mixed_ms) / min(float_ms):.2f}",
            ]


def lab_row(title: str, scenes: Sequence[tuple[str, int, range]]) -> list[str]:
    """Return the row of scenes of the lab."""
    frames = list(render(scenes))
    full = found_by(build(DetectorConfig(crops=False)), frames)
    node = build(DetectorConfig(crops=False, near_input=NEAR))
    found = found_by(node, frames)
    near, lost = node.status().counters.get("near_inputs", 0), compare(frames, full, found)
    return [
        title,
        f"{near} of {len(frames)}",
        f"{len(full)} -> {len(found)} of {lost.people}",
        f"{-100 * lost.recall:+.1f} %",
        f"{1000 * lost.position_m:+.1f} mm",
        f"{lost.yaw_deg:+.2f} deg",
    ]


def real_rows(shared: Path) -> Iterator[list[str]]:
    """Yield the rows of the marked real frames that follow each other."""
    full = load_model(ModelSettings())
    near = load_model(ModelSettings(input_height=NEAR.height, input_width=NEAR.width))
    sizes, counts = InputSizeChoice(NEAR), dict[str, list[int]]()
    for name, rgb, marks in real_frames(shared):
        if not name.endswith("half"):
            continue
        is_near, all_people = sizes.is_near("front"), full.detect(rgb)
        people = near.detect(rgb) if is_near else all_people
        sizes.note("front", is_near, people, rgb.shape[:2])
        before, after = (int(matches_of_marks(p, marks).sum()) for p in (all_people, people))
        row = counts.setdefault(name, [0] * 5)
        for column, number in enumerate((1, is_near, before, after, len(marks))):
            row[column] += number
    for name, (frames, nears, before, after, marked) in counts.items():
        change = f"{100 * (after - before) / max(marked, 1):+.1f} %"
        yield [
            f"filinha, {name}",
            f"{nears} of {frames}",
            f"{before} -> {after} of {marked}",
            *(change, "-", "-"),
        ]


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    shared: Path = parser.parse_args().shared
    lost = [lab_row("lab, people near", NEAR_SCENES), lab_row("lab, near and far", HELD_OUT)]
    if shared.exists():
        lost += real_rows(shared)
    print(markdown(LOSSES, lost), flush=True)
    write(
        __file__,
        "A smaller input while all people are near",
        "MoveNet with 256x320, and with 160x224 while all people are apart and "
        f"{NEAR.person_min_px:g} px high in it or more; each frame in {NEAR.full_every} is full. "
        "Size and height were chosen on the first half of filinha (3 Hz, six people) and on other "
        "scenes of the lab. The frames of the lab are 0.1 to 0.5 s apart, those of a camera 0.03 "
        "to 0.1 s: more people come and go between two of them.",
        markdown(LOSSES, lost),
        f"One run of the network on one thread: median (least to greatest) of {ROUNDS} rounds in "
        "which all take turns. Near scenes: three of four frames have the smaller input. Last "
        "column: least times, over float at 256x320 with the same engine.",
        markdown(TIMES, list(times())),
    )


if __name__ == "__main__":
    main()
