"""Lock on the chosen person: evidence by continuity, appearance and reachability."""

import math
from dataclasses import dataclass

import msgspec

from people4d.messages import TargetCommand, Track
from people4d.messages.target import TargetState
from services.target.appearance import Appearance
from services.target.belief import (
    ARRIVAL,
    ARRIVAL_NAMED,
    PRIOR_MAX,
    TrackBelief,
    absence,
    exchange,
    posterior,
    settle,
    spread,
)
from services.target.choice import find_person
from services.target.config import TargetConfig
from services.target.enrolment import Enrolled
from services.target.height import TorsoHeight
from services.target.observe import TargetCandidate, TargetFrame

CROP_NS = 80_000_000  # minimum interval between two weighted crops [ns]
CROPS_MIN = 2  # minimum number of crops for a lock by appearance
VETO_RATIO = -1.0  # minimum log ratio of the last crop for a lock
CERTAIN = 0.97  # minimum probability of a track from which views are learnt
VISIBLE_NS = 150_000_000  # maximum time since the last match of a visible person [ns]
OCCLUDED_NS = 2_000_000_000  # maximum duration of an occlusion [ns]
GAP_NS = 1_000_000_000  # minimum interval between frames that makes all tracks ambiguous [ns]
CHOICE_NS = 5_000_000_000  # maximum wait for a person that was chosen [ns]
RAISED_HAND_NS = 30_000_000_000  # maximum wait for a raised hand [ns]
REACH_M = 1.0  # reach of the person beyond its maximum speed, errors of positions included [m]


class Memory(msgspec.Struct):
    """State that outlives the process."""

    chooser: str = ""
    command: TargetCommand | None = None  # choice whose person is not found yet
    command_ns: int | None = None  # [ns] stamp of the first frame after the choice
    is_chosen: bool = False  # True: a person is chosen
    name: str = ""  # name of an enrolled person; empty: not enrolled
    problem: str = ""  # reason for having no person
    locked: int = 0  # last locked track
    frame_id: str = ""
    stamp_ns: int | None = None  # [ns] last frame
    locked_ns: int | None = None  # [ns] last frame with a lock; None after a clock reset
    locked_m: tuple[float, float] = (0.0, 0.0)  # [m] position in the last frame with a lock
    tracks: dict[int, TrackBelief] = {}
    appearance: Appearance = msgspec.field(default_factory=Appearance)
    height: TorsoHeight = msgspec.field(default_factory=TorsoHeight)

    @property
    def arrival(self) -> float:
        """Probability that a new track is the absent person."""
        return ARRIVAL if self.locked or not self.name else ARRIVAL_NAMED

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
    """Follows one person through the frames, and never switches to another person."""

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

    def choose_enrolled(self, command: TargetCommand, enrolled: Enrolled | None) -> None:
        """Replace the choice by an enrolled person; by no person if it is None."""
        memory = self.memory = Memory(
            chooser=command.chooser,
            stamp_ns=self.memory.stamp_ns,
            frame_id=self.memory.frame_id,
            tracks=self.memory.tracks,
        )
        if enrolled:
            memory.is_chosen, memory.name = True, command.name or ""
            memory.appearance = Appearance(enrolled.embedder, enrolled.views)
            spread(memory.tracks, memory.arrival)

    def restore(self, memory: Memory) -> None:
        """Continue from the memory of another process; all tracks are ambiguous."""
        self.memory = memory
        spread(memory.tracks, memory.arrival)

    def update(self, frame: TargetFrame) -> Decision:
        """Process one frame."""
        elapsed_ns = self._check_clock(frame)
        self._check_embedder(frame)
        self._follow_tracks(frame)
        positions_m = {p.id: (p.track.position_m[0], p.track.position_m[1]) for p in frame.people}
        exchange(self.memory.tracks, positions_m, elapsed_ns / 1e9)
        if self.memory.command:
            self._resolve(self.memory.command, frame)
        if not self.memory.is_chosen:
            self._prepare(frame)
            waits = self.memory.command is not None
            return Decision("searching" if waits else "none", self.memory.problem)
        counted = self._weigh_crops(frame)
        decision = self._decide(frame)
        if decision.track and decision.state == "locked" and decision.probability >= CERTAIN:
            self._learn_own(decision.track.id, counted)
        self._learn_others(counted)
        return decision

    def _check_clock(self, frame: TargetFrame) -> int:
        """Return the time since the last frame [ns]; any exchange is possible after a gap.

        Times and positions are forgotten after a reset.
        """
        memory, last_ns = self.memory, self.memory.stamp_ns
        elapsed_ns = 0 if last_ns is None else frame.stamp_ns - last_ns
        is_reset = elapsed_ns < 0 or (memory.frame_id != frame.frame_id)
        if is_reset or elapsed_ns > GAP_NS:
            spread(memory.tracks, memory.arrival)
        if is_reset:
            memory.locked_ns = memory.command_ns = None
            memory.height = TorsoHeight()
            for one in memory.tracks.values():
                one.matched_ns = one.crop_ns = frame.stamp_ns - GAP_NS
        memory.stamp_ns, memory.frame_id = frame.stamp_ns, frame.frame_id
        return max(elapsed_ns, 0)

    def _resolve(self, command: TargetCommand, frame: TargetFrame) -> None:
        """Choose the person of a command, or give up after a wait."""
        memory = self.memory
        person, problem = find_person(command, frame)
        if person:
            memory.is_chosen, memory.command, memory.problem = True, None, ""
            settle(memory.tracks, person.id)
            memory.appearance.own = memory.appearance.others.pop(person.id, [])
            return
        memory.problem = problem
        if memory.command_ns is None:
            memory.command_ns = frame.stamp_ns
        wait_ns = RAISED_HAND_NS if command.action == "raised_hand" else CHOICE_NS
        if frame.stamp_ns - memory.command_ns > wait_ns:
            memory.command = None

    def _prepare(self, frame: TargetFrame) -> None:
        """Learn views of all people until one is chosen; drop them after an exchange."""
        for person in frame.people:
            one = self.memory.tracks[person.id]
            if one.contact or one.crops == 0:
                self.memory.appearance.others.pop(person.id, None)
            if person.embedding is not None and not one.contact:
                one.crops += 1
                self.memory.appearance.learn_other(person.id, person.embedding)

    def _check_embedder(self, frame: TargetFrame) -> None:
        """Drop all views of another embedder; then an enrolled person cannot be found."""
        memory = self.memory
        if frame.embedder is None or frame.embedder == memory.appearance.embedder:
            return
        if memory.name and not memory.locked:
            before = " of length ".join(map(str, memory.appearance.embedder))
            memory.problem = f"{memory.name} is enrolled with the embedder {before}: enrol again"
            memory.is_chosen, memory.name = False, ""
        memory.appearance = Appearance(frame.embedder)

    def _follow_tracks(self, frame: TargetFrame) -> None:
        """Find new and interrupted tracks; forget ended ones."""
        ages = {person.id: person.track.age for person in frame.people}
        known = {i: e for i, e in self.memory.tracks.items() if e.age <= ages.get(i, -1)}
        tracks, absent = dict[int, TrackBelief](), absence(known)
        for person in frame.people:
            arrival = self.memory.arrival * absent * self._is_reachable(person.track, frame)
            one, before = known.get(person.id), 0.0
            if one is None:
                one = TrackBelief(0, frame.stamp_ns, arrival)
            else:
                before = one.prior
                if person.track.detection is not None:
                    one.match(frame.stamp_ns, arrival)
            one.age, tracks[person.id] = person.track.age, one
            absent += before - one.prior
        self.memory.tracks = tracks

    def _is_reachable(self, track: Track, frame: TargetFrame) -> bool:
        """Check that the chosen person can be at a track."""
        if self.memory.locked_ns is None:
            return True
        elapsed_s = (frame.stamp_ns - self.memory.locked_ns) / 1e9
        distance_m = math.dist(track.position_m[:2], self.memory.locked_m)
        return distance_m <= REACH_M + self._config.speed_max_mps * elapsed_s

    def _weigh_crops(self, frame: TargetFrame) -> list[TargetCandidate]:
        """Add whole crops to the evidence of their tracks; return the people with new crops."""
        tracks, appearance = self.memory.tracks, self.memory.appearance
        counted = list[TargetCandidate]()
        others = {
            p.id for p in frame.people if p.track.detection is not None and not tracks[p.id].prior
        }
        for person in frame.people:
            one = tracks[person.id]
            if person.embedding is None or frame.stamp_ns - one.crop_ns < CROP_NS:
                continue
            one.crop_ns = frame.stamp_ns
            counted.append(person)
            if appearance.own and not person.is_cut:
                elsewhere, is_open = others - {person.id}, one.prior < CERTAIN
                ratio = appearance.log_ratio(person.embedding, elsewhere, is_open)
                one.add_ratio(ratio + is_open * self.memory.height.log_ratio(person.height_m))
        return counted

    def _decide(self, frame: TargetFrame) -> Decision:
        """Return the state by the probabilities of all tracks."""
        memory = self.memory
        probabilities = posterior(memory.tracks)
        best = max(frame.people, key=lambda p: probabilities[p.id], default=None)
        probability = probabilities[best.id] if best else 0.0
        if best and probability >= self._config.probability_min and self._is_lockable(best):
            reason = "continued" if memory.locked == best.id else "recognised by appearance"
            memory.locked, memory.locked_ns = best.id, frame.stamp_ns
            memory.locked_m = float(best.track.position_m[0]), float(best.track.position_m[1])
            return Decision("locked", reason, best.track, probability)
        hidden_ns = None if memory.locked_ns is None else frame.stamp_ns - memory.locked_ns
        for person in frame.people:
            is_hidden = person.id == memory.locked and not self._is_visible(person)
            if is_hidden and hidden_ns is not None and hidden_ns <= OCCLUDED_NS:
                reason, share = "hidden for a moment", probabilities[person.id]
                return Decision("occluded", reason, person.track, share)
        is_lost = hidden_ns is None or hidden_ns > self._config.lost_after_s * 1e9
        reason = self._reason_of_search(best.id if best else None, probability)
        return Decision("lost" if is_lost else "searching", reason, None, probability)

    def _is_lockable(self, person: TargetCandidate) -> bool:
        one = self.memory.tracks[person.id]
        is_known = one.prior >= self._config.probability_min or one.crops >= CROPS_MIN
        return is_known and one.ratio > VETO_RATIO and self._is_visible(person)

    def _is_visible(self, person: TargetCandidate) -> bool:
        """Check that a camera has just detected a person; cameras take turns."""
        since_ns = (self.memory.stamp_ns or 0) - self.memory.tracks[person.id].matched_ns
        return since_ns <= VISIBLE_NS

    def _reason_of_search(self, best: int | None, probability: float) -> str:
        """Return the reason why no track is locked."""
        if not self.memory.appearance.own:
            return "no clear view of the person is known"
        if best is None:
            return "no person is in view"
        if probability >= self._config.probability_min:
            return f"person {best} is hidden, or was seen too briefly"
        if probability == 0.0:
            return f"the {len(self.memory.tracks)} people in view are others"
        return f"person {best} is the likeliest, with a probability of {probability:.2f}"

    def _learn_own(self, target: int, counted: list[TargetCandidate]) -> None:
        """Learn views of the person, unless another person is close."""
        memory = self.memory
        if memory.tracks[target].contact:
            return
        settle(memory.tracks, target)
        for person in counted:
            if person.id == target and person.embedding is not None:
                memory.appearance.learn_own(person.embedding)
                memory.height.learn(person.height_m)

    def _learn_others(self, counted: list[TargetCandidate]) -> None:
        """Learn views of each track that is another person by continuity."""
        for person in counted:
            one = self.memory.tracks[person.id]
            is_other = one.prior <= 1.0 - PRIOR_MAX and not one.contact
            if is_other and person.embedding is not None:
                self.memory.appearance.learn_other(person.id, person.embedding)
