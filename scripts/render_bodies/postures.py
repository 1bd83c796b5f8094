"""Motions of people who sit, lie, bend, squat and fall."""

from typing import get_args

from lab.motion.acts import end_s
from lab.motion.motion import PersonMotion, simulate
from lab.scenario import Act, PersonPlan
from scripts.render_people.outfits import DressedBody, Rng
from scripts.render_people.views import MOTION_S

MOVES = get_args(Act.__annotations__["move"])


def draw_postures(rng: Rng, body: DressedBody) -> PersonMotion:
    """Draw a motion of acts in a row, in one place."""
    acts, at_s = list[Act](), 1.0
    while at_s < MOTION_S:
        move, for_s = MOVES[rng.integers(len(MOVES))], float(rng.uniform(1, 4))
        acts.append(Act(at_s=at_s, move=move, for_s=for_s))
        at_s = end_s(acts[-1]) + 0.5
    plan = PersonPlan(body="adam", start=(2.0, 0.0), acts=tuple(acts))
    return simulate([plan], [body.body.skeleton], MOTION_S, int(rng.integers(2**31)))[0]
