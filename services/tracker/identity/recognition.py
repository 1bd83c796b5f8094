"""Whether newcomers are people who were here before: the gallery, asked and filled by a tracker."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from people4d.messages import F64
from services.tracker.identity.config import IdentityConfig
from services.tracker.identity.gallery import Decision, Gallery, Newcomer
from services.tracker.interface import Measurement
from services.tracker.motion.population import Look, Population, Target
from services.tracker.strongsort3d.contact import Scene


@dataclass(frozen=True, slots=True)
class Sight:
    """Somebody seen in this frame."""

    target: Target
    measurement: Measurement
    clear: bool  # whether the picture shows them alone
    certainty: float  # of the match, 0 to 1


@dataclass(slots=True)
class _Waiting:
    """A track whose identity is still open."""

    since_ns: int  # [ns] stamp of the first sight
    clear: list[F64] = field(default_factory=list)  # embeddings of clear pictures
    others: list[F64] = field(default_factory=list)  # embeddings of other pictures


class Recognition:
    """Gives newcomers an identity before anybody is told of them.

    A track that could be of somebody who left stays tentative until enough of its pictures are
    clear, or they were waited for in vain.

    Args:
        config: How it is decided.
        people: Of the tracker; identities of theirs are changed.
    """

    def __init__(self, config: IdentityConfig, people: Population) -> None:
        self._config = config
        self._people = people
        self.gallery = Gallery(config)
        self._waiting: dict[int, _Waiting] = {}

    def clear(self) -> None:
        """Forget what everyone looks like."""
        self.gallery.clear()
        self._waiting.clear()

    def update(self, sights: Sequence[Sight], now: Scene) -> None:
        """Decide who newcomers are, and remember how everybody looks.

        Args:
            sights: Everyone seen in this frame but those seen for the first time.
            now: The frame and C_cos of the embedder.
        """
        stamp_ns, limit = now.observation.stamp_ns, self._config.match_max or now.c_cos
        self.gallery.forget_old(stamp_ns)
        for sight in sights:
            look = sight.target.look
            if look.identity is not None:
                sight.target.look = Look("continued", sight.certainty, look.reason)
                self._remember(sight, stamp_ns)
        for sight in sights:
            if sight.target.look.identity is None:
                self._ask(sight, stamp_ns, limit)
        ids = {target.id for target in self._people.targets}
        self._waiting = {id_: w for id_, w in self._waiting.items() if id_ in ids}

    def _ask(self, sight: Sight, stamp_ns: int, limit: float) -> None:
        """Decide who a newcomer is, or let them wait."""
        target, embedding = sight.target, sight.measurement.embedding
        waiting = self._waiting.setdefault(target.id, _Waiting(stamp_ns))
        if embedding is not None:
            (waiting.clear if self._is_good(sight) else waiting.others).append(embedding)
        if not target.confirmed:
            return
        newcomer = Newcomer(target.x[:3], stamp_ns, waiting.clear or waiting.others)
        candidates = self.gallery.plausible(newcomer, self._present())
        waits = stamp_ns - waiting.since_ns < self._config.wait_s * 1e9
        if candidates and waits and len(waiting.clear) < self._config.evidence:
            target.confirmed = False
            return
        self._settle(target, self.gallery.decide(newcomer, candidates, limit))
        self._remember(sight, stamp_ns)

    def _settle(self, target: Target, decision: Decision) -> None:
        del self._waiting[target.id]
        target.look = Look(decision.kind, decision.confidence, decision.reason)
        if decision.id is not None:
            # Who was still predicted elsewhere is here.
            others = [t for t in self._people.targets if t.id != decision.id]
            self._people.targets = others
            target.id = decision.id

    def _present(self) -> set[int]:
        """Return the identities of everyone seen in this frame."""
        return {t.id for t in self._people.targets if t.detection is not None}

    def _remember(self, sight: Sight, stamp_ns: int) -> None:
        embedding = sight.measurement.embedding if self._is_good(sight) else None
        self.gallery.see(sight.target.id, sight.target.x[:3], stamp_ns, embedding)

    def _is_good(self, sight: Sight) -> bool:
        return sight.clear and sight.measurement.score >= self._config.score_min
