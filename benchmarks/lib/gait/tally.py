"""Comparisons of points and steps of people against joints, and their figures."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from evaluation.gait.run import GaitRun, estimate_gait
from people4d.messages import CameraInfo
from services.gait.config import GaitConfig
from services.gait.estimator import ESTIMATOR_COUNTERS, GaitEstimator, GaitFrame, GaitResult


@dataclass
class Tally:
    """Comparisons of one person, or of several."""

    errors_m: dict[str, list[float]] = field(default_factory=dict)  # errors by limb and visibility
    measured_hidden: int = 0
    # Number of hidden points measured with an error above HIDDEN_OFF_M
    measured_hidden_off: int = 0
    hidden: int = 0  # number of published hidden points
    hidden_all: int = 0  # number of hidden points, including lost ones
    exchanged: dict[str, list[bool]] = field(default_factory=dict)  # by visibility
    covered: dict[str, list[bool]] = field(default_factory=dict)  # predicted points, by visibility
    visible: int = 0
    visible_measured: int = 0
    visible_in_range: int = 0  # number of visible points within the range of depth
    true: int = 0
    found: int = 0
    true_in_range: int = 0
    found_in_range: int = 0
    invented: int = 0
    wrong_foot: int = 0
    walkers: int = 0
    with_measures: int = 0
    length_off_m: list[float] = field(default_factory=list)
    cadence_off: list[float] = field(default_factory=list)  # errors in steady walking
    turns_cadence_off: list[float] = field(default_factory=list)  # errors from all true strides
    asymmetry_off: list[float] = field(default_factory=list)
    limps: int = 0  # number of true asymmetries of 8 % or more
    limps_found: int = 0  # number of true limps with the correct side
    limps_invented: int = 0  # number of limps without a true limp, or at the wrong side
    # Found, true and invented steps of other packages by method
    peers: dict[str, list[tuple[int, int, int]]] = field(default_factory=dict)
    live: list[bool] = field(default_factory=list)  # number of measures in frames after three steps

    def add(self, other: "Tally") -> None:
        """Add the comparisons of another person."""
        for name, value in vars(other).items():
            own = getattr(self, name)
            if isinstance(value, int):
                setattr(self, name, own + value)
            elif isinstance(value, list):
                own.extend(value)
            else:
                for key, some in value.items():
                    own.setdefault(key, []).extend(some)


def total(tallies: Iterable[Tally]) -> Tally:
    """Return the sum of the comparisons of several people."""
    together = Tally()
    for one in tallies:
        together.add(one)
    return together


def cells(one: Tally) -> Mapping[str, str]:
    """Return the figures of a tally by column."""

    def errors(*kinds: str) -> str:
        known = 100 * np.array([error for kind in kinds for error in one.errors_m.get(kind, [])])
        return f"{np.median(known):.1f}, {np.quantile(known, 0.9):.1f}" if len(known) else "-"

    def percent(count: float, of: float) -> str:
        return f"{100 * count / of:.1f}" if of else "-"

    def share(flags: Mapping[str, list[bool]], when: str) -> str:
        known = flags.get(when, [])
        return percent(sum(known), len(known))

    worst_m = max((abs(x) for x in one.length_off_m), default=np.nan)
    worst = max((abs(x) for x in one.cadence_off), default=np.nan)
    turning = max((abs(x) for x in one.turns_cadence_off), default=np.nan)
    shown = sum(len(one.errors_m.get(f"{kind} visible", [])) for kind in ("hand", "foot"))
    near = sum(len(one.errors_m.get(f"{kind} in range", [])) for kind in ("hand", "foot"))
    uneven = max((abs(x) for x in one.asymmetry_off), default=np.nan)
    return {
        "steps found": f"{one.found} of {one.true}",
        "in range of depth": f"{one.found_in_range} of {one.true_in_range}",
        "invented": str(one.invented),
        "other foot": str(one.wrong_foot),
        "walkers with measures": f"{one.with_measures} of {one.walkers}",
        "live %": percent(sum(one.live), len(one.live)),
        "worst step cm": f"{100 * worst_m:.1f}",
        "worst cadence %": f"{100 * worst:.1f}",
        "worst cadence, turns %": f"{100 * turning:.1f}",
        "worst asymmetry off %": f"{100 * uneven:.1f}",
        "limps found": f"{one.limps_found} of {one.limps}",
        "limps invented": str(one.limps_invented),
        "hands visible cm": errors("hand visible"),
        "hands visible, measured cm": errors("hand measured"),
        "hands visible, in range cm": errors("hand in range"),
        "hands hidden cm": errors("hand hidden"),
        "feet visible cm": errors("foot visible"),
        "feet visible, measured cm": errors("foot measured"),
        "feet visible, in range cm": errors("foot in range"),
        "feet hidden cm": errors("foot hidden"),
        "limbs visible cm": errors("hand visible", "foot visible"),
        "visible published %": percent(shown, one.visible),
        "the same in range %": percent(near, one.visible_in_range),
        "visible measured %": percent(one.visible_measured, one.visible),
        "hidden as measured %": percent(one.measured_hidden, one.hidden),
        "the same, > 10 cm off %": percent(one.measured_hidden_off, one.hidden),
        "the same of all hidden %": percent(one.measured_hidden, one.hidden_all),
        "exchanged visible %": share(one.exchanged, "visible"),
        "exchanged hidden %": share(one.exchanged, "hidden"),
        "visible in 90 % ellipse %": share(one.covered, "visible"),
        "hidden in 90 % ellipse %": share(one.covered, "hidden"),
    }


Results = list[Sequence[GaitResult]]


def results_of(run: GaitRun, other: GaitConfig) -> tuple[list[GaitFrame], Results, Results]:
    """Return the frames of a run, without images, and the results in each by two configurations.

    `other` is the second configuration, on the same observations.
    """
    frames: list[GaitFrame] = []
    results: Results = []
    others: Results = []
    second: list[GaitEstimator] = []

    def on_frame(info: CameraInfo, frame: GaitFrame, found: Sequence[GaitResult]) -> None:
        if not second:
            second.append(GaitEstimator(other, info, Counter(dict.fromkeys(ESTIMATOR_COUNTERS, 0))))
        others.append(second[0].update_people(frame) or ())
        empty = np.empty((0, 0), np.uint16)
        frames.append(replace(frame, rgb=np.empty((0, 0, 3), np.uint8), depth_mm=empty))
        results.append(found)

    for _ in estimate_gait(run, on_frame):
        pass
    return frames, results, others
