"""Figures of chosen people: wrong locks, availability and returns."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.target.play import FollowedFrame

ABSENT_S = 1.0  # minimum absence [s]
WITHIN_S = 1.5  # maximum time until the lock after a return [s]


@dataclass(frozen=True)
class FollowScores:
    """Figures of one or more chosen people."""

    choices: int
    duration_s: float
    wrong_frames: int
    stray_frames: int
    wrong_locks: int  # number of uninterrupted sequences of wrong frames
    visible: int  # [frames]
    locked: int  # [frames] visible and correctly locked
    returns: int
    reacquired: int  # returns with a correct lock within WITHIN_S

    def row(self, name: str) -> list[str]:
        """Return the figures as a row of a table."""
        hours = max(self.duration_s / 3600, 1e-9)
        return [
            name,
            f"{self.choices}",
            f"{self.duration_s / 60:.0f}",
            f"{self.wrong_frames}",
            f"{self.stray_frames}",
            f"{self.wrong_locks / hours:.1f}",
            f"{100 * self.locked / max(1, self.visible):.0f}",
            f"{self.reacquired} of {self.returns}",
        ]


HEADER = (
    *("rule", "choices", "minutes", "wrong frames", "stray frames"),
    "wrong locks an hour",
    *("available %", "re-acquired within 1.5 s"),
)


def score(people: Sequence[Sequence[FollowedFrame]]) -> FollowScores:
    """Return the figures over some chosen people."""
    returns = [found for frames in people for found in _returns(frames)]
    every = [frame for frames in people for frame in frames]
    wrong = [[frame.is_wrong for frame in frames] for frames in people]
    return FollowScores(
        choices=len(people),
        duration_s=sum(_duration_s(frames) for frames in people),
        wrong_frames=sum(frame.is_wrong for frame in every),
        stray_frames=sum(frame.is_stray for frame in every),
        wrong_locks=sum(
            now and not before
            for one in wrong
            for before, now in zip([False, *one[:-1]], one, strict=True)
        ),
        visible=sum(frame.is_visible for frame in every),
        locked=sum(_is_right(f) for f in every),
        returns=len(returns),
        reacquired=sum(returns),
    )


def _is_right(frame: FollowedFrame) -> bool:
    return frame.is_visible and frame.is_locked and not frame.is_wrong and not frame.is_stray


def _duration_s(frames: Sequence[FollowedFrame]) -> float:
    return (frames[-1].stamp_ns - frames[0].stamp_ns) / 1e9 if frames else 0.0


def _returns(frames: Sequence[FollowedFrame]) -> Iterator[bool]:
    """Yield for each return after an absence whether the person was locked in time.

    The person has to stay visible for WITHIN_S.
    """
    last_ns = frames[0].stamp_ns if frames else 0
    for index, frame in enumerate(frames):
        if not frame.is_visible:
            continue
        absent_s, last_ns = (frame.stamp_ns - last_ns) / 1e9, frame.stamp_ns
        until_ns = frame.stamp_ns + WITHIN_S * 1e9
        window = [f for f in frames[index:] if f.stamp_ns <= until_ns]
        stays = all(f.is_visible for f in window) and frames[-1].stamp_ns >= until_ns
        if absent_s >= ABSENT_S and stays:
            yield any(_is_right(f) for f in window)
