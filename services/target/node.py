"""Node of the chosen person: tracks, appearance and commands in, the person's state out."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, ClassVar

import msgspec
import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply, invert
from common.io.packed import pack, unpack
from common.runtime.node import LoopCallbacks, StatefulNode, Status
from common.transport.trace import span
from people4d.errors import ConfigError
from people4d.messages import (
    F64,
    Detections,
    Embeddings,
    Message,
    MovingTransform,
    Odometry,
    Predictions,
    Skeletons,
    StaticTransform,
    Target,
    TargetCommand,
    Tracks,
)
from services.target.chosen import ChosenPerson, Decision, Memory
from services.target.config import TargetConfig
from services.target.enrolment import FILE, Enrolment
from services.target.hands import RaisedHands
from services.target.observe import observe_people

TRANSFORMS = StaticTransform | MovingTransform | Odometry
FRAMES_MAX = 64  # maximum number of frames of detections that wait for their tracks
SILENT_NS = 1_000_000_000  # minimum time without tracks before commands are answered [ns]
CLOCK_JUMP_NS = 1_000_000_000  # minimum backward step of the stamps in a clock reset [ns]
PREDICTION_NS = 1_000_000_000  # maximum age of a predicted path [ns]
# Header of an answer before any tracks
NO_TRACKS = Tracks(stamp_ns=0, sequence=0, camera="none", frame_id="map", tracker="")
FORGOTTEN = TargetCommand(stamp_ns=0, sequence=0, action="none")
COUNTERS = (
    "commands",
    "replaced_choices",  # choices in place of a choice of another chooser
    "stale",  # tracks older than the last ones
    "clock_resets",
    "without_embeddings",  # frames with people and without their embeddings or detections
)


class TargetNode(StatefulNode):
    """Publishes a Target for every frame of Tracks.

    If frames stop, the tracker's predicted tracks give a Target that tells the robot to stop, and
    a command is answered at once.
    """

    inputs: tuple[type[Message], ...] = (
        *(Tracks, Detections, Embeddings, Predictions, Skeletons, TargetCommand),
        *(StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Tracks, Detections, Embeddings)

    def __init__(self, config: TargetConfig) -> None:
        self._config = config
        self._chosen = ChosenPerson(config)
        self._transforms = TransformBuffer()
        self._joined: dict[type[Message], dict[tuple[str, int], Any]] = {
            Detections: {},
            Embeddings: {},
        }
        self._predictions: Predictions | None = None
        self._hands = RaisedHands()
        self._enrolment = Enrolment(None, 0.0)
        self._answered_ns: int | None = None  # [ns] stamp of the last command
        self._problem = ""  # reason why it was not executed, if it is enrol or forget
        self._replaced = ""  # note about the replaced chooser
        self._tracks: Tracks | None = None  # last tracks
        self._arrived_ns = 0  # [ns] monotonic time of their arrival
        self._sequence = 0
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))

    def attach(self, loop: LoopCallbacks) -> None:
        """Open the file of enrolled people."""
        days, folder = self._config.enrolment_days, loop.state_folder
        if days and not folder:
            raise ConfigError(
                "target.enrolment_days needs a state folder",
                "Set PEOPLE4D_STATE, or start it with people4d up --target.",
            )
        self._enrolment = Enrolment(folder and folder / FILE, days)

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Process one message; return the state of the chosen person at tracks."""
        if isinstance(message, TRANSFORMS):
            self._transforms.add_transform(message)
        elif isinstance(message, Detections | Embeddings):
            waiting = self._joined[type(message)]
            waiting[message.camera, message.stamp_ns] = message
            if len(waiting) > FRAMES_MAX:
                del waiting[next(iter(waiting))]
        elif isinstance(message, Predictions):
            self._predictions = message
        elif isinstance(message, Skeletons):
            self._hands.update(message)
        elif isinstance(message, TargetCommand):
            self._choose(message)
            if self._tracks is None or now_ns - self._arrived_ns > SILENT_NS:
                last = self._tracks or NO_TRACKS
                return [self._target(last, self._without_frames(), None)]
        elif isinstance(message, Tracks) and message.predicted:
            return [self._target(message, self._without_frames(), None)]
        elif isinstance(message, Tracks) and self._is_next(message):
            self._tracks, self._arrived_ns = message, now_ns
            with span("target"):
                base = self._base_from(message)
                return [self._target(message, self._update(message, base), base)]
        return ()

    def status(self) -> Status:
        """Return the counters, and a damaged file of enrolled people."""
        counters = {**self._counters, **self._transforms.counters}
        reason = self._enrolment.problem if self._config.enrolment_days else ""
        return Status(state="degraded" if reason else "ready", reason=reason, counters=counters)

    def next_number(self) -> int:
        """Return 0, since the service numbers nothing."""
        return 0

    def save(self) -> bytes:
        """Return the choice and what is known of the person."""
        memory = self._chosen.memory
        return pack(memory if memory.has_choice else Memory())

    def restore(self, saved: bytes, next_number: int) -> None:  # noqa: ARG002
        """Continue from a saved state."""
        if saved:
            self._chosen.restore(unpack(saved, Memory))

    def _choose(self, command: TargetCommand) -> None:
        """Replace the choice, and note the chooser whose choice was in force; or enrol a person."""
        memory, name = self._chosen.memory, command.name or ""
        self._counters["commands"] += 1
        self._answered_ns, self._problem = command.stamp_ns, ""
        if command.action in ("enrol", "forget"):
            self._problem = self._enrol(name) if command.action == "enrol" else self._forget(name)
            return
        is_replaced = memory.has_choice and memory.chooser != command.chooser
        self._replaced = f"; chosen in place of {memory.chooser!r}" if is_replaced else ""
        self._counters["replaced_choices"] += is_replaced
        if command.action == "name":
            enrolled, problem = self._enrolment.find(name)
            self._chosen.choose_enrolled(command, enrolled)
            self._chosen.memory.problem = problem
        else:
            self._chosen.choose(command)

    def _enrol(self, name: str) -> str:
        """Store the views of the locked person; return the reason if that fails."""
        memory = self._chosen.memory
        if memory.locked_ns is None or memory.locked_ns != memory.stamp_ns:
            return "no person is locked: choose one with people4d follow ID"
        if not memory.appearance.own:
            return "no clear view of the person is known"
        if memory.name not in ("", name):
            return f"this person is enrolled as {memory.name}: people4d forget {memory.name}"
        if name != memory.name and self._enrolment.find(name)[0]:
            return f"{name} is enrolled already: people4d forget {name}"
        problem = self._enrolment.enrol(name, memory.appearance.embedder, memory.appearance.own)
        memory.name = memory.name if problem else name
        return problem

    def _forget(self, name: str) -> str:
        """Delete the views of a person, and end its choice; return the reason if that fails."""
        if self._chosen.memory.name == name:
            self._chosen.choose_enrolled(FORGOTTEN, None)
        return self._enrolment.forget(name)

    def _is_next(self, tracks: Tracks) -> bool:
        """Check that tracks are not older than the last ones; count clock resets."""
        last_ns = self._chosen.memory.stamp_ns
        if last_ns is not None and tracks.stamp_ns < last_ns:
            is_reset = last_ns - tracks.stamp_ns >= CLOCK_JUMP_NS
            self._counters["clock_resets" if is_reset else "stale"] += 1
            return is_reset
        return True

    def _update(self, tracks: Tracks, base: F64 | None) -> Decision:
        key = tracks.camera, tracks.stamp_ns
        detections, embeddings = (self._joined[k].pop(key, None) for k in (Detections, Embeddings))
        # A frame without crops may precede its embeddings, which have no vectors.
        is_joined = detections is not None and (embeddings is not None or detections.crops == 0)
        self._counters["without_embeddings"] += bool(tracks.tracks) and not is_joined
        robot_m = None if base is None else invert(base)[:2, 3]
        raised = self._hands.held(tracks.stamp_ns)
        return self._chosen.update(observe_people(tracks, detections, embeddings, robot_m, raised))

    def _without_frames(self) -> Decision:
        """Return the state while no frames arrive."""
        has_choice = self._chosen.memory.has_choice
        return Decision("searching" if has_choice else "none", "no frames arrive")

    def _base_from(self, tracks: Tracks) -> F64 | None:
        """Return base_from_tracks at the stamp; None if unknown."""
        base = self._config.base_frame
        found = self._transforms.lookup(base, tracks.frame_id, tracks.stamp_ns)
        return None if found is None else found.matrix

    def _target(self, tracks: Tracks, decision: Decision, base: F64 | None) -> Target:
        """Return the message; `base` is base_from_tracks, None if unknown."""
        self._sequence += 1
        reason = decision.reason
        if decision.state == "none":
            reason = f"no person is chosen{f': {reason}' if reason else ''}"
        target = Target(
            stamp_ns=tracks.stamp_ns,
            sequence=self._sequence - 1,
            trace=tracks.trace,
            state=decision.state,
            frame_id=tracks.frame_id,
            camera=tracks.camera,
            probability=decision.probability,
            reason=reason + self._replaced,
            chooser=self._chosen.memory.chooser,
            answered_ns=self._answered_ns,
            problem=self._problem,
        )
        track = decision.track
        if track is None:
            return target
        times_s, path_m = self._path(track.id, tracks)
        distance_m, bearing_rad = _direction(track.position_m, base)
        return msgspec.structs.replace(
            target,
            id=track.id,
            position_m=track.position_m,
            velocity_mps=track.velocity_mps,
            distance_m=distance_m,
            bearing_rad=bearing_rad,
            stop=False,
            path_times_s=times_s,
            path_m=path_m,
        )

    def _path(self, track: int, tracks: Tracks) -> tuple[tuple[float, ...], F64 | None]:
        """Return times [s] after the stamp, and positions (Hx2) of the newest predicted path."""
        found, stamp_ns = self._predictions, tracks.stamp_ns
        if found is None or found.frame_id != tracks.frame_id:
            return (), None
        age_ns = stamp_ns - found.stamp_ns
        path = next((one.means_m for one in found.people if one.id == track), None)
        if path is None or not 0 <= age_ns <= PREDICTION_NS:
            return (), None
        times_s = np.array(found.horizons_s) - age_ns / 1e9
        ahead = times_s > 0
        return tuple(times_s[ahead].tolist()), path[ahead]


def _direction(position_m: F64, base: F64 | None) -> tuple[float | None, float | None]:
    """Return distance [m] and bearing [rad] from the robot's base; None if unknown."""
    if base is None:
        return None, None
    x, y, _ = apply(base, position_m).tolist()
    return math.hypot(x, y), math.atan2(y, x)
