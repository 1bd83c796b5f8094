"""Random scenes of daily life and of falls, as geometry, from a seed."""

import numpy as np

from lab.bodies.cast import cast_names
from lab.camera.plan import CameraPlan
from lab.motion.acts import FALLS, end_s
from lab.scenario import Act, Gesture, PersonPlan, Scenario, Waypoint
from lab.world import World

FPS = 10.0  # frame rate [Hz]
FOCAL_PX = 450.0  # focal length, with which raised hands and feet are in view at 3.3 m [px]
DAILY = ("bend", "squat", "tie_shoes", "sit", "sit", "sit_tie_shoes", "lie", "lie_back")
DAILY_ACTS = (*DAILY, "lie_in_bed", "lie_in_bed")
WALKERS = 0.35  # share of people who walk


def daily_life(seed: int, duration_s: float = 60.0) -> World:
    """Return a scene of two people without falls."""
    rng = np.random.default_rng([seed, 1])
    people = [_daily(rng, start, duration_s) for start in _starts(rng)]
    return _world(rng, people, duration_s, seed)


def fall(seed: int) -> World:
    """Return a scene of 14 s in which the first of two people falls and stays or gets up."""
    rng = np.random.default_rng([seed, 2])
    act = Act(
        at_s=float(rng.uniform(4, 7)),
        move=str(rng.choice(FALLS)),  # type: ignore[arg-type]
        move_s=float(rng.uniform(0.55, 1.1)),
        for_s=float(rng.uniform(3, 8)),
    )
    start = (float(rng.uniform(3.3, 4.1)), float(rng.uniform(-0.3, 0.3)))
    other = (float(rng.uniform(3.3, 4.3)), float(rng.choice([-1.4, 1.4])))
    walks = bool(rng.random() < 0.5)
    goal = (start[0] + float(rng.uniform(-0.3, 0.6)), start[1] + float(rng.uniform(-0.6, 0.6)))
    path = (Waypoint(to=goal, stop_s=60.0),) if walks else ()
    faller = _person(rng, start, path=path, acts=(act,))
    return _world(rng, [faller, _daily(rng, other, 14.0)], 14.0, seed)


def standing(seed: int, duration_s: float) -> World:
    """Return a scene of two people who stand."""
    rng = np.random.default_rng([seed, 3])
    people = [_person(rng, start) for start in _starts(rng)]
    return _world(rng, people, duration_s, seed)


def seated(seed: int, duration_s: float) -> World:
    """Return a scene of two people who sit down and stay, without gestures."""
    rng = np.random.default_rng([seed, 4])
    act = Act(at_s=2.0, move="sit", move_s=1.5, for_s=duration_s)
    return _world(rng, [_person(rng, one, acts=(act,)) for one in _starts(rng)], duration_s, seed)


def _starts(rng: np.random.Generator) -> list[tuple[float, float]]:
    return [(float(rng.uniform(3.2, 4.3)), float(y + rng.uniform(-0.2, 0.2))) for y in (-0.8, 0.8)]


def _person(rng: np.random.Generator, start: tuple[float, float], **fields: object) -> PersonPlan:
    return PersonPlan(
        body=str(rng.choice(cast_names())),
        start=start,
        face_deg=float(rng.uniform(-180, 180)),
        size=float(rng.uniform(0.88, 1.08)),
        **fields,  # type: ignore[arg-type]
    )


def _daily(rng: np.random.Generator, start: tuple[float, float], duration_s: float) -> PersonPlan:
    if rng.random() < WALKERS:
        stops = [
            (float(rng.uniform(2.5, 4.6)), float(rng.uniform(-1.3, 1.3)))
            for _ in range(int(duration_s / 4))
        ]
        path = tuple(Waypoint(to=to, stop_s=float(rng.uniform(0, 3))) for to in stops)
        return _person(rng, start, path=path, speed_mps=float(rng.uniform(0.6, 1.2)))
    acts, gestures, time_s = [], [], float(rng.uniform(1, 4))
    while time_s < duration_s - 5:
        if rng.random() < 0.3:
            gesture = _gesture(rng, time_s)
            gestures.append(gesture)
            time_s += gesture.for_s + 1
            continue
        act = Act(
            at_s=time_s,
            move=str(rng.choice(DAILY_ACTS)),  # type: ignore[arg-type]
            move_s=float(rng.uniform(0.8, 2.2)),
            for_s=float(rng.uniform(2, 8)),
        )
        acts.append(act)
        time_s = end_s(act) + float(rng.uniform(1, 4))
    return _person(rng, start, acts=tuple(acts), gestures=tuple(gestures))


def _gesture(rng: np.random.Generator, at_s: float) -> Gesture:
    return Gesture(
        at_s=at_s,
        for_s=float(rng.uniform(3, 6)),
        move_s=float(rng.uniform(0.5, 1.0)),
        hand=str(rng.choice(["left", "right"])),  # type: ignore[arg-type]
        move=str(rng.choice(["before_torso", "raise", "wave", "point"])),  # type: ignore[arg-type]
    )


def _world(
    rng: np.random.Generator, people: list[PersonPlan], duration_s: float, seed: int
) -> World:
    camera = CameraPlan(
        at=(0.0, 0.0, float(rng.uniform(1.1, 1.6))),
        pitch_deg=float(rng.uniform(5, 11)),
        focal_px=FOCAL_PX,
        fps=FPS,
        avoided=False,
    )
    scenario = Scenario(
        about="Postures, falls and gestures",
        duration_s=duration_s,
        room="square",
        camera=camera,
        people=tuple(people),
    )
    return World(scenario, seed)
