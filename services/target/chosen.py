"""Lock on the chosen person: evidence by continuity, appearance and reachability."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from people4d.messages import F64, TargetCommand, Track
from people4d.messages.target import TargetState
from services.target.appearance import Appearance
from services.target.config import TargetConfig
from services.target.observe import TargetCandidate, TargetFrame

CROP_NS = 80_000_000  # minimum interval between two crops that count [ns]
CROP_WEIGHT = 0.5  # weight of a crop: successive crops are correlated
CROPS_MIN = 3  # minimum number of crops of a track that is locked by appearance
ODDS_MAX = 6.0  # maximum logarithm of the odds
ODDS_NEW = -1.0  # logarithm of the odds of a new track
ODDS_AMBIGUOUS = 1.0  # maximum logarithm of the odds after a possible exchange
ODDS_SETTLED = 5.0  # minimum logarithm of the odds of a settled track
VETO_RATIO = -0.5  # log ratio of a crop below which its track is not locked
UNMATCHED_NS = 300_000_000  # gap of a track after which it may continue with another person [ns]
VISIBLE_NS = 150_000_000  # maximum time since the last match of a visible person [ns]
OCCLUDED_NS = 2_000_000_000  # maximum duration of an occlusion [ns]
GAP_NS = 1_000_000_000  # interval between frames after which all tracks are ambiguous [ns]
CHOICE_NS = 5_000_000_000  # maximum wait for a person that was chosen [ns]
TOUCH_M = 0.7  # distance below which two tracks may exchange their people [m]
TOUCH_FACTOR = 0.9  # factor of the odds per crop interval while two tracks touch
AT_M = 1.0  # maximum distance of a person from a chosen position [m]
REACH_M = 1.0  # reach of the person beyond its maximum speed, errors of positions included [m]


class TrackEvidence(msgspec.Struct):
    """Evidence that one track is the chosen person."""

    age: int  # [frames] of the track
    matched_ns: int  # [ns] last match
    log_odds: float = ODDS_NEW
    crops: int = 0  # number of crops that counted
    crop_ns: int = 0  # [ns] stamp of the last counted crop
    ratio: float = 0.0  # log ratio of that crop
    settled: bool = False  # True: certain, and no possible exchange since
    # reason why the track is another person; empty: it may be the chosen one
    other: str = ""
    touches: bool = False  # True: close to a track with which it may be exchanged

    def make_ambiguous(self) -> None:
        """Limit the odds after a possible switch of the track to another person."""
        self.log_odds = min(max(self.log_odds, ODDS_NEW), ODDS_AMBIGUOUS)
        self.settled, self.other, self.crops = False, "", 0


class Memory(msgspec.Struct):
    """State that outlives the process."""

    chooser: str = ""
    command: TargetCommand | None = None  # choice without its person so far
    command_ns: int | None = None  # [ns] stamp of the first frame after the choice
    is_chosen: bool = False  # True: a person is chosen
    problem: str = ""  # reason for having no person
    locked: int = 0  # last locked track
    frame_id: str = ""
    stamp_ns: int | None = None  # [ns] last frame
    locked_ns: int | None = None  # [ns] last frame with a lock; None after a clock reset
    locked_m: tuple[float, float] = (0.0, 0.0)  # [m] position at that time
    tracks: dict[int, TrackEvidence] = {}
    appearance: Appearance = msgspec.field(default_factory=Appearance)

    @property
    def has_choice(self) -> bool:
        """True if a person is chosen, or a choice waits for its person."""
        return self.is_chosen or self.command is not None


@dataclass(frozen=True)
class Decision:
    """State of the chosen person at a frame."""

    state: TargetState
    reason: str
    track: Track | None = None  # track of a person who is locked or occluded
    probability: float = 0.0


class ChosenPerson:
    """Follows one person through the frames, and never switches to another person.

    Each track has odds of being the chosen person. Crops raise or lower the odds; a possible
    exchange of people by the tracker limits them. A track visible at the same time as the person
    is another person until a possible exchange.
    """

    def __init__(self, config: TargetConfig) -> None:
        self._config = config
        self.memory = Memory()

    def choose(self, command: TargetCommand) -> None:
        """Replace the choice."""
        before = self.memory
        self.memory = Memory(
            chooser=command.chooser,
            command=None if command.action == "none" else command,
            stamp_ns=before.stamp_ns,
            frame_id=before.frame_id,
            tracks={} if before.is_chosen else before.tracks,
            appearance=Appearance() if before.is_chosen else before.appearance,
        )

    def restore(self, memory: Memory) -> None:
        """Continue from the memory of another process; all tracks are ambiguous."""
        self.memory = memory
        self._make_all_ambiguous()

    def update(self, frame: TargetFrame) -> Decision:
        """Process one frame."""
        self._check_clock(frame)
        self._check_embedder(frame)
        self._follow_tracks(frame)
        self._find_touches(frame)
        if self.memory.command:
            self._resolve(self.memory.command, frame)
        if not self.memory.is_chosen:
            self._prepare(frame)
            waits = self.memory.command is not None
            return Decision("searching" if waits else "none", self.memory.problem)
        counted = [person for person in frame.people if self._add_crop(person, frame)]
        decision = self._decide(frame)
        if decision.state == "locked" and decision.track:
            self._learn(decision.track, counted, frame)
        return decision

    def _check_clock(self, frame: TargetFrame) -> None:
        """Make tracks ambiguous after a gap; forget times and positions after a reset."""
        memory, last_ns = self.memory, self.memory.stamp_ns
        elapsed_ns = 0 if last_ns is None else frame.stamp_ns - last_ns
        is_reset = elapsed_ns < 0 or (memory.frame_id != frame.frame_id)
        if is_reset or elapsed_ns > GAP_NS:
            self._make_all_ambiguous()
        if is_reset:
            memory.locked_ns = memory.command_ns = None
            for evidence in memory.tracks.values():
                evidence.matched_ns = evidence.crop_ns = frame.stamp_ns - GAP_NS
        memory.stamp_ns, memory.frame_id = frame.stamp_ns, frame.frame_id

    def _make_all_ambiguous(self) -> None:
        for evidence in self.memory.tracks.values():
            evidence.make_ambiguous()

    def _resolve(self, command: TargetCommand, frame: TargetFrame) -> None:
        """Choose the person of a command, or give up after a wait."""
        memory = self.memory
        person, problem = _find_person(command, frame)
        if person:
            memory.is_chosen, memory.command, memory.problem = True, None, ""
            evidence = memory.tracks[person.id]
            evidence.log_odds, evidence.settled = ODDS_MAX, True
            memory.appearance.own = memory.appearance.others.pop(person.id, [])
            return
        memory.problem = problem
        if memory.command_ns is None:
            memory.command_ns = frame.stamp_ns
        if frame.stamp_ns - memory.command_ns > CHOICE_NS:
            memory.command = None

    def _prepare(self, frame: TargetFrame) -> None:
        """Learn views of all people until one is chosen; drop them after an exchange."""
        for person in frame.people:
            evidence = self.memory.tracks[person.id]
            if evidence.touches or not evidence.settled:
                self.memory.appearance.others.pop(person.id, None)
            evidence.settled = not evidence.touches
            if person.embedding is not None and evidence.settled:
                self.memory.appearance.learn_other(person.id, person.embedding)

    def _check_embedder(self, frame: TargetFrame) -> None:
        """Drop all views of another embedder."""
        if frame.embedder and frame.embedder != self.memory.appearance.embedder:
            self.memory.appearance = Appearance(frame.embedder)

    def _follow_tracks(self, frame: TargetFrame) -> None:
        """Find new and interrupted tracks; forget ended ones."""
        memory, known = self.memory, self.memory.tracks
        memory.tracks = {}
        for person in frame.people:
            track, evidence = person.track, known.get(person.id)
            if evidence is None or track.age < evidence.age:
                evidence = TrackEvidence(
                    track.age, frame.stamp_ns, other=self._unreachable(track, frame)
                )
            unmatched_ns = frame.stamp_ns - evidence.matched_ns
            if unmatched_ns > UNMATCHED_NS:
                evidence.make_ambiguous()
            if track.detection is not None:
                evidence.matched_ns = frame.stamp_ns
            evidence.age = track.age
            memory.tracks[person.id] = evidence

    def _unreachable(self, track: Track, frame: TargetFrame) -> str:
        """Return the reason why the chosen person cannot be at a new track; empty if possible."""
        if self.memory.locked_ns is None:
            return ""
        elapsed_s = (frame.stamp_ns - self.memory.locked_ns) / 1e9
        distance_m = math.dist(track.position_m[:2], self.memory.locked_m)
        is_far = distance_m > REACH_M + self._config.speed_max_mps * elapsed_s
        return f"{distance_m:.1f} m away after {elapsed_s:.1f} s" if is_far else ""

    def _find_touches(self, frame: TargetFrame) -> None:
        """Make tracks ambiguous that come close to others with which they may be exchanged."""
        tracks, touching = self.memory.tracks, set[int]()
        for a, b in itertools.combinations(frame.people, 2):
            pair = tracks[a.id], tracks[b.id]
            is_close = math.dist(a.track.position_m[:2], b.track.position_m[:2]) < TOUCH_M
            if is_close and not (pair[0].other and pair[1].other):
                touching |= {a.id, b.id}
        for id_, evidence in tracks.items():
            if id_ in touching and not evidence.touches:
                evidence.make_ambiguous()
            evidence.touches = id_ in touching

    def _add_crop(self, person: TargetCandidate, frame: TargetFrame) -> bool:
        """Add the crop of a track to its evidence; return False if it does not count."""
        evidence, appearance = self.memory.tracks[person.id], self.memory.appearance
        if person.embedding is None or frame.stamp_ns - evidence.crop_ns < CROP_NS:
            return False
        evidence.crop_ns = frame.stamp_ns
        if evidence.other:
            appearance.learn_other(person.id, person.embedding)
        elif appearance.own:
            absent = [id_ for id_, e in self.memory.tracks.items() if e.other]
            ratio = appearance.log_ratio(person.embedding, absent, not evidence.settled)
            odds = evidence.log_odds * (TOUCH_FACTOR if evidence.touches else 1.0)
            odds += CROP_WEIGHT * ratio
            evidence.log_odds = min(max(odds, -ODDS_MAX), ODDS_MAX)
            evidence.ratio, evidence.crops = ratio, evidence.crops + 1
            evidence.settled |= evidence.log_odds >= ODDS_SETTLED and not evidence.touches
        return True

    def _decide(self, frame: TargetFrame) -> Decision:
        """Return the state by the probabilities of all tracks."""
        memory = self.memory
        odds = {i: math.exp(e.log_odds) for i, e in memory.tracks.items() if not e.other}
        total = 1.0 + sum(odds.values())
        best = max(frame.people, key=lambda p: odds.get(p.id, 0.0), default=None)
        probability = odds.get(best.id, 0.0) / total if best else 0.0
        if best and probability >= self._config.probability_min and self._is_lockable(best):
            reason = "continued" if memory.locked == best.id else "recognised by appearance"
            memory.locked, memory.locked_ns = best.id, frame.stamp_ns
            memory.locked_m = float(best.track.position_m[0]), float(best.track.position_m[1])
            return Decision("locked", reason, best.track, probability)
        hidden_ns = None if memory.locked_ns is None else frame.stamp_ns - memory.locked_ns
        for person in frame.people:
            is_hidden = person.id == memory.locked and not self._is_visible(person)
            if is_hidden and hidden_ns is not None and hidden_ns <= OCCLUDED_NS:
                share = odds.get(person.id, 0.0) / total
                return Decision("occluded", "hidden for a moment", person.track, share)
        is_lost = hidden_ns is None or hidden_ns > self._config.lost_after_s * 1e9
        reason = self._reason_of_search(best.id if best else None, probability)
        return Decision("lost" if is_lost else "searching", reason, None, probability)

    def _is_lockable(self, person: TargetCandidate) -> bool:
        evidence = self.memory.tracks[person.id]
        is_known = evidence.settled or evidence.crops >= CROPS_MIN
        return is_known and evidence.ratio > VETO_RATIO and self._is_visible(person)

    def _is_visible(self, person: TargetCandidate) -> bool:
        """Check that a camera has just detected a person; cameras take turns."""
        since_ns = (self.memory.stamp_ns or 0) - self.memory.tracks[person.id].matched_ns
        return since_ns <= VISIBLE_NS

    def _reason_of_search(self, best: int | None, probability: float) -> str:
        """Return the reason why no track is locked."""
        candidates = [e for e in self.memory.tracks.values() if not e.other]
        if not self.memory.appearance.own:
            return "no clear view of the person is known"
        if not candidates or best is None:
            number = len(self.memory.tracks)
            return f"the {number} people in view are others" if number else "no person is in view"
        return f"person {best} is the likeliest, with a probability of {probability:.2f}"

    def _learn(self, target: Track, counted: list[TargetCandidate], frame: TargetFrame) -> None:
        """Learn views of the person, and find other people beside it, if the lock is certain."""
        tracks = self.memory.tracks
        own = tracks[target.id]
        if not own.settled or own.touches or own.log_odds < ODDS_SETTLED:
            return
        for person in frame.people:
            evidence = tracks[person.id]
            if (
                person.id != target.id
                and person.track.detection is not None
                and not evidence.touches
            ):
                evidence.other = "visible beside the person"
        for person in counted:
            if person.id == target.id and person.embedding is not None:
                self.memory.appearance.learn_own(person.embedding)


def _find_person(command: TargetCommand, frame: TargetFrame) -> tuple[TargetCandidate | None, str]:
    """Return the visible person of a command, or None and the reason."""
    visible = [person for person in frame.people if person.track.detection is not None]
    if command.action == "id":
        found = next((person for person in visible if person.id == command.id), None)
        return found, f"person {command.id} is not in view"
    origin_m = frame.robot_m if command.action == "nearest" else command.position_m
    if origin_m is None:
        return None, "the nearest person is unknown without the pose of the robot's base"
    by_distance = sorted(_distances(visible, origin_m), key=lambda pair: pair[0])
    reach_m = AT_M if command.action == "at" else math.inf
    if by_distance and by_distance[0][0] <= reach_m:
        return by_distance[0][1], ""
    where = f"within {AT_M:g} m of ({origin_m[0]:.1f}, {origin_m[1]:.1f})"
    return None, f"no person is in view{f' {where}' if command.action == 'at' else ''}"


def _distances(
    people: list[TargetCandidate], origin_m: F64
) -> Iterator[tuple[float, TargetCandidate]]:
    return ((math.dist(p.track.position_m[:2], origin_m[:2]), p) for p in people)
