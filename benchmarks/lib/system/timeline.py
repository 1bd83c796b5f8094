"""A picture of frames over time while processes come and go."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

mpl.use("Agg")

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")  # told apart by colour-blind people, too
BIN_S = 0.5


@dataclass(frozen=True)
class Frame:
    """A frame whose people a subscriber got.

    Args:
        sequence: Its number.
        sent_s: Wall clock when the camera sent it.
        latency_s: Time until the subscriber had its people.
        detector: Process that found them.
    """

    sequence: int
    sent_s: float
    latency_s: float
    detector: str


@dataclass(frozen=True)
class Event:
    """Something that was done to a process.

    Args:
        what: In few words.
        at_s: Wall clock.
    """

    what: str
    at_s: float


def draw(frames: Sequence[Frame], events: Sequence[Event], file: Path) -> None:
    """Draw latency and detector of every frame, lost frames, and who does how many.

    Args:
        frames: In order.
        events: What happened meanwhile.
        file: PNG to be written.
    """
    start_s = frames[0].sent_s
    figure = Figure(figsize=(9, 5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    names = sorted({frame.detector for frame in frames})
    edges = [k * BIN_S for k in range(int((frames[-1].sent_s - start_s) / BIN_S) + 2)]
    for name, colour in zip(names, COLOURS, strict=False):
        own = [frame for frame in frames if frame.detector == name]
        times_s = [frame.sent_s - start_s for frame in own]
        latencies_ms = [frame.latency_s * 1e3 for frame in own]
        above.scatter(times_s, latencies_ms, s=9, color=colour, label=name)
        below.hist(
            times_s, edges, weights=[1 / BIN_S] * len(own), histtype="step", color=colour, lw=1.5
        )
    lost_s = [s - start_s for s in lost(frames)]
    above.scatter(lost_s, [0] * len(lost_s), marker="x", color="black", s=24, label="lost")
    for event in events:
        for axes in (above, below):
            axes.axvline(event.at_s - start_s, color="grey", lw=0.8, ls="--")
        above.annotate(
            event.what,
            (event.at_s - start_s, 1),
            xycoords=("data", "axes fraction"),
            rotation=20,
            fontsize=8,
        )
    above.set_ylabel("latency [ms]")
    above.set_ylim(bottom=-5)
    above.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, fontsize=8)
    below.set_ylabel("frames done [1/s]")
    below.set_xlabel("time [s]")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


def lost(frames: Sequence[Frame]) -> list[float]:
    """Return when the frames were sent that never came, evenly between those that did."""
    times_s = []
    for one, two in itertools.pairwise(frames):
        count = two.sequence - one.sequence
        step_s = (two.sent_s - one.sent_s) / max(count, 1)
        times_s += [one.sent_s + k * step_s for k in range(1, count)]
    return times_s
