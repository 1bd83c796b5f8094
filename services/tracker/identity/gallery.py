"""What people look like, kept after they left, so that they are known when they come back."""

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from people4d.messages import F64
from services.tracker.identity.config import IdentityConfig


@dataclass(slots=True)
class Identity:
    """One person remembered."""

    position_m: F64  # 3, where they were seen last
    seen_ns: int  # [ns] when
    views: list[F64] = field(default_factory=list)  # unit vectors, as different as can be


@dataclass(frozen=True, slots=True)
class Newcomer:
    """Somebody whose identity is asked for."""

    position_m: F64  # 3, where they are
    stamp_ns: int  # [ns] now
    embeddings: Sequence[F64]  # unit vectors of one model


@dataclass(frozen=True, slots=True)
class Decision:
    """Who somebody is.

    Args:
        kind: "refused": somebody known looks like them, but it is not sure that it is them.
        id: Of the person known again; None: the newcomer keeps their own.
        confidence: Share of this answer among all, 0 to 1.
        reason: In words.
    """

    kind: Literal["new", "reidentified", "refused"]
    id: int | None
    confidence: float
    reason: str


class Gallery:
    """The people of one tracker and one embedder; both people and their views are bounded.

    Args:
        config: What is kept and how it is decided.
    """

    def __init__(self, config: IdentityConfig) -> None:
        self._config = config
        self.people: dict[int, Identity] = {}

    def clear(self) -> None:
        """Forget everyone."""
        self.people.clear()

    def see(self, person: int, position_m: F64, stamp_ns: int, embedding: F64 | None) -> None:
        """Remember that a person was seen, and a view of them unless it is like one known.

        Args:
            person: Identity.
            position_m: 3, in the map.
            stamp_ns: Of the frame.
            embedding: Unit vector; None: the picture was not clear.
        """
        known = self.people.pop(person, None) or Identity(position_m, stamp_ns)
        known.position_m, known.seen_ns = position_m.copy(), stamp_ns
        self.people[person] = known  # at the end: the first one was not seen for longest
        if len(self.people) > self._config.identities:
            del self.people[next(iter(self.people))]
        if embedding is not None:
            add_view(known.views, embedding, self._config.view_gap, self._config.views)

    def forget_old(self, stamp_ns: int) -> None:
        """Forget who was not seen for long."""
        oldest_ns = stamp_ns - self._config.keep_s * 1e9
        while self.people:
            person = next(iter(self.people))
            if self.people[person].seen_ns >= oldest_ns:
                return
            del self.people[person]

    def plausible(self, newcomer: Newcomer, present: Container[int]) -> list[int]:
        """Return who, absent now, could have walked to where the newcomer is."""
        config = self._config
        return [
            person
            for person, known in self.people.items()
            if person not in present
            and known.views
            and math.dist(newcomer.position_m, known.position_m)
            <= config.jump_m + config.speed_max_mps * (newcomer.stamp_ns - known.seen_ns) / 1e9
        ]

    def decide(self, newcomer: Newcomer, candidates: Sequence[int], limit: float) -> Decision:
        """Return who of the candidates a newcomer is, or why none of them.

        Each candidate is as far as the mean of the newcomer's pictures is from the nearest of their
        views; that nobody known is back stands at `limit`. A possibility at distance d has the
        weight exp(-d / temperature), and its share of all is the confidence.

        Args:
            newcomer: Who came, with at least one embedding if there are candidates.
            candidates: From `plausible`.
            limit: Largest cosine distance of the same person.
        """
        if not candidates or not newcomer.embeddings:
            what = "nobody known could be here" if not candidates else "no picture of them"
            return Decision("new", None, 1.0 if not candidates else 0.5, what)
        query = np.mean(newcomer.embeddings, axis=0)
        query /= max(float(np.linalg.norm(query)), 1e-6)
        distances = [view_distance(query, self.people[person].views) for person in candidates]
        order = sorted(range(len(candidates)), key=lambda k: (distances[k], candidates[k]))
        best = order[0]
        # Of several who stand out of nobody's way the second best is the rival.
        rival = distances[order[1]] if len(order) > 1 else math.inf
        weights = np.exp(
            -(np.array([*distances, limit]) - min(*distances, limit)) / self._config.temperature
        )
        shares = weights / weights.sum()
        reason = f"looks {distances[best]:.2f} from {candidates[best]}"
        reason += f", {rival:.2f} from {candidates[order[1]]}" if len(order) > 1 else ""
        if distances[best] > limit:
            return Decision("new", None, float(shares[-1]), f"{reason}: above {limit:.2f}")
        if rival - distances[best] < self._config.margin:
            return Decision("refused", None, float(1 - shares[best]), f"{reason}: too alike")
        return Decision("reidentified", candidates[best], float(shares[best]), reason)


def view_distance(query: F64, views: Sequence[F64]) -> float:
    """Return the cosine distance to the nearest view."""
    return float(np.clip(1.0 - np.max(np.asarray(views) @ query), 0.0, 2.0))


def add_view(views: list[F64], embedding: F64, gap: float, most: int) -> None:
    """Add an embedding that differs from all others by more than a gap.

    If there are too many then, of the two that are most alike the older one goes.
    """
    if views and view_distance(embedding, views) <= gap:
        return
    views.append(embedding)
    if len(views) > most:
        alike = np.asarray(views) @ np.asarray(views).T
        np.fill_diagonal(alike, -np.inf)
        first, second = np.unravel_index(int(np.argmax(alike)), alike.shape)
        del views[int(min(first, second))]
