"""An outside attacker, with plain Zenoh and MessagePack and nothing of the project.

`python attacker.py ENDPOINT ROBOT ATTACK [NAMES]` runs one attack and exits. Messages are learned
by listening, changed, and sent. NAMES is how many names are invented.
"""

import copy
import json
import math
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import msgpack
import zenoh
import zenoh.ext

Fields = dict[str, Any]
LISTEN_S = 20.0
ASK_S = 4.0  # wait before the history is requested again [s]; a busy machine may lose a reply
NAMES = 500
DETECTIONS_MAX = 512  # maximum number of detections in a message
FRESH_S = 0.3  # a frame older than 1 s is dropped
HOUR_NS = 3_600_000_000_000
EXTREME: list[Any] = [
    *(math.nan, math.inf, -math.inf, 1e308, -1e308, 2**63 - 1, -(2**63), 2**64 - 1),
    *("\x1b]0;title\x07", "\u202egnp.exe", "x" * 70_000, b"\x00" * 9, [[[[]]]], {"a": {"b": 1}}),
    msgpack.ExtType(5, b"ext"),
    msgpack.Timestamp(1, 1),
]
TOPICS = [
    *("raw/front/rgbd", "raw/front/compressed", "camera/front/info", "transforms/x", "moving/x"),
    *("odometry", "detections/front", "raw/front/crops", "embeddings/front", "people", "gait"),
    *("predictions", "boxes/front", "truth", "score", "health/detector/detector-1"),
]
ATTACKS: dict[str, Callable[["Attacker"], None]] = {}


def attack(run: Callable[["Attacker"], None]) -> Callable[["Attacker"], None]:
    """Register an attack under the name of its function."""
    ATTACKS[run.__name__] = run
    return run


class Attacker:
    """A session with the router of another system."""

    def __init__(self, endpoint: str, robot: str, names: int) -> None:
        self.names = names
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        self.session = zenoh.open(config)
        self.root = f"people4d/v1/{robot}"

    def hear(self, key: str) -> tuple[str, Fields]:
        """Wait for a message; return its key and fields."""
        expression = f"{self.root}/{key}"
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        end_s = time.monotonic() + LISTEN_S
        while time.monotonic() < end_s:
            channel: Any = zenoh.handlers.FifoChannel(4)
            subscriber: Any = zenoh.ext.declare_advanced_subscriber(
                self.session, expression, channel, history=history
            )
            sample = first_of(subscriber, ASK_S)
            subscriber.undeclare()
            if sample is not None:
                return str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())
        raise TimeoutError(f"nothing on {expression}")

    def send(self, key: str, message: Any) -> None:
        """Send encoded fields, or raw bytes."""
        payload = message if isinstance(message, bytes) else msgpack.packb(message)
        full = key if key.startswith("people4d/") else f"{self.root}/{key}"
        self.session.put(full, payload, congestion_control=zenoh.CongestionControl.BLOCK)


def first_of(subscriber: Any, seconds: float) -> Any:
    """Return the first sample, None if none arrives in time."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        sample = subscriber.try_recv()
        if sample is not None:
            return sample
        time.sleep(0.01)
    return None


def array(values: list[float]) -> Fields:
    """Encode a matrix of one row, float64."""
    import struct  # noqa: PLC0415

    data = struct.pack(f"<{len(values)}d", *values)
    return {"dtype": "float64", "shape": [len(values)], "data": data}


def leaves(fields: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths of all values; of a list only the path of the first element."""
    if isinstance(fields, dict):
        for name, value in fields.items():
            yield from leaves(value, (*path, name))
    elif isinstance(fields, list) and fields:
        yield from leaves(fields[0], (*path, 0))
    else:
        yield path


def changed(fields: Fields, path: tuple[Any, ...], value: Any) -> Fields:
    """Return fields with another value at a path."""
    result = copy.deepcopy(fields)
    inner: Any = result
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value
    return result


@attack
def garbage_on_every_topic(attacker: Attacker) -> None:
    """Random bytes, cut messages, nested values, and maps shorter than their declared length."""
    chance = random.Random(0)
    _, fields = attacker.hear("detections/*")
    message = msgpack.packb(fields)
    payloads = [
        *(b"", b"\xc1", b"\x81" * 10_000, b"\x91" * 100_000, b"\xdf\xff\xff\xff\xff"),
        *(b"\xdd\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff"),
        *(message[: len(message) // 2], message + b"\x00", message[1:], msgpack.packb([fields])),
        *(msgpack.packb(fields | {"message": name}) for name in ("Nothing", "", 7, None)),
        *(msgpack.packb(fields | {"version": version}) for version in (0, 99, "2", None)),
        msgpack.packb([[]] * 4096),
    ]
    for key in TOPICS:
        for payload in payloads:
            attacker.send(key, payload)
        for _ in range(20):
            attacker.send(key, chance.randbytes(chance.randint(1, 2000)))
        time.sleep(0.05)


@attack
def messages_of_one_topic_on_all_others(attacker: Attacker) -> None:
    """Valid messages where another type belongs."""
    for key in ("detections/*", "people", "health/tracker/*"):
        _, fields = attacker.hear(key)
        for other in TOPICS:
            if other.partition("/")[0] not in key:
                attacker.send(other, fields)


@attack
def extreme_values_in_every_field(attacker: Attacker) -> None:
    """NaN, infinity, ends of integers, terminal commands, reversed text, and other types."""
    for topic in ("detections/*", "people", "camera/*/info", "transforms/*", "health/reid/*"):
        key, fields = attacker.hear(topic)
        for path in leaves(fields):
            for value in EXTREME:
                if path[0] not in ("message", "version"):
                    attacker.send(key, changed(fields, path, value))
        time.sleep(0.1)


@attack
def absurd_but_finite_values(attacker: Attacker) -> None:
    """Calibrations, transforms, deviations and stamps that are finite numbers."""
    key, info = attacker.hear("camera/*/info")
    for name, value in (("cx", 1e308), ("fx", 1e-300), ("fy", 1e300), ("width", 10**9)):
        attacker.send(key, info | {name: value})
    attacker.send(key, info | {"distortion": [1e10] * 5})
    key, pose = attacker.hear("transforms/*")
    for distance_m in (1e9, 1e100, 1e308):
        matrix = [1.0, 0, 0, distance_m, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]
        attacker.send(key, pose | {"matrix": array(matrix) | {"shape": [4, 4]}})
    key, found = attacker.hear("detections/*")
    for stamp_ns in (2**63 - 1, 2**62 + 1, -(2**63), -(2**62) - 1):
        attacker.send(key, found | {"stamp_ns": stamp_ns})
    for person in found["detections"][:1]:
        person |= {"heading": array([1.0, 0.0, 0.0]), "heading_sigma_rad": 1e300}
        attacker.send(key, found | {"detections": [person]})
        person |= {"heading_sigma_rad": 1.0, "position_m": array([1e200, 0.0, 1e200])}
        attacker.send(key, found | {"detections": [person]})


@attack
def a_forged_calibration(attacker: Attacker) -> None:
    """Other focal lengths, another size and another pose, in the name of the camera."""
    key, info = attacker.hear("camera/front/info")
    pose_key, pose = attacker.hear("transforms/*")
    wider = info | {"fx": info["fx"] / 2, "fy": info["fy"] / 2}
    for number in range(5):
        forged = {"sequence": 10**6 + number, "stamp_ns": info["stamp_ns"] + number}
        attacker.send(key, wider | forged)
        attacker.send(key, info | forged | {"width": 8, "height": 8})
        matrix = array([1.0, 0, 0, 3.0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0])
        moved = forged | {"matrix": matrix | {"shape": [4, 4]}}
        attacker.send(pose_key, pose | moved)
        # Other links between the same two frames: backwards, and moving
        attacker.send("transforms/map", pose | moved | {"parent": pose["child"], "child": "map"})
        shorter = {"message": "MovingTransform", "parent": "map", "child": info["frame_id"]}
        attacker.send(f"moving/{info['frame_id']}", pose | moved | shorter)
        time.sleep(0.1)


@attack
def a_camera_an_hour_ahead(attacker: Attacker) -> None:
    """Detections of another camera whose clock is an hour ahead."""
    for number in range(15):
        _, found = attacker.hear("detections/*")
        other = found | {"camera": "other", "sequence": number}
        attacker.send("detections/other", other | {"stamp_ns": found["stamp_ns"] + HOUR_NS})
        time.sleep(0.05)


@attack
def a_camera_half_a_second_behind(attacker: Attacker) -> None:
    """Detections of another camera whose clock is behind."""
    for number in range(15):
        _, found = attacker.hear("detections/*")
        late = {"stamp_ns": found["stamp_ns"] - 500_000_000, "sequence": number}
        attacker.send("detections/other", found | {"camera": "other", "detections": []} | late)
        time.sleep(0.05)


@attack
def frames_in_the_name_of_a_camera(attacker: Attacker) -> None:
    """Detections with stamps far from a camera's, many in a row, between its own."""
    for number in range(10):
        key, found = attacker.hear("detections/*")
        ahead_ns = (HOUR_NS, -HOUR_NS)[number % 2]
        for following in range(20):
            step = {"stamp_ns": found["stamp_ns"] + ahead_ns + following * 1_000_000}
            attacker.send(key, found | step | {"sequence": found["sequence"] + following})


@attack
def a_reader_that_stops(attacker: Attacker) -> None:
    """Subscribe to everything and stop reading; the process stops itself."""
    channel: Any = zenoh.handlers.FifoChannel(1)
    subscriber: Any = attacker.session.declare_subscriber("people4d/**", channel)
    subscriber.recv()
    os.kill(os.getpid(), signal.SIGSTOP)


@attack
def embeddings_of_frames_that_do_not_exist(attacker: Attacker) -> None:
    """A hundred megabytes of embeddings that wait for frames."""
    vectors = {"dtype": "float32", "shape": [1, 250_000], "data": bytes(1_000_000)}
    _, found = attacker.hear("detections/*")
    for number in range(100):
        fields = {
            "message": "Embeddings",
            "version": 1,
            "stamp_ns": found["stamp_ns"] + number,
            "sequence": 10**9 + number,
            "trace": [],
            "camera": f"c{number % 7}",
            "model": "histogram",
            "detections": [0],
            "vectors": vectors,
        }
        attacker.send("embeddings/front", fields)


@attack
def embeddings_of_another_length(attacker: Attacker) -> None:
    """Embeddings that arrive before the real ones, of other lengths."""
    for number in range(6):
        _, found = attacker.hear("detections/*")
        count, length = len(found["detections"]), (1, 7, 5000)[number % 3]
        data = b"\x00\x00\x80\x3f" * (count * length)
        fields = {name: found[name] for name in ("stamp_ns", "sequence", "camera", "trace")}
        fields |= {"message": "Embeddings", "version": 1, "detections": list(range(count))}
        fields |= {"model": ("histogram", "other")[number % 2]}
        fields["vectors"] = {"dtype": "float32", "shape": [count, length], "data": data}
        attacker.send("embeddings/front", fields)


@attack
def invented_instances(attacker: Attacker) -> None:
    """Heartbeats of thousands of processes, with long reasons."""
    _, health = attacker.hear("health/detector/*")
    for number in range(max(attacker.names, 5000)):
        instance = f"detector-{number + 100}"
        fields = health | {"instance": instance, "pid": number, "sequence": number}
        attacker.send(f"health/detector/{instance}", fields | {"reason": "r" * 500})


@attack
def as_many_messages_of_one_camera(attacker: Attacker) -> None:
    """Detections, calibrations and transforms in numbers that cost time without new names."""
    send_as_cameras(attacker, ["one_more"] * attacker.names)


@attack
def invented_frames_of_one_camera(attacker: Attacker) -> None:
    """Detections of another camera with a different frame name in each message."""
    for number in range(200):
        if number % 25 == 0:
            _, found = attacker.hear("detections/*")
        fields = {"camera": "unmounted", "frame_id": f"f{number}", "sequence": number}
        fields |= {"stamp_ns": found["stamp_ns"] + number % 25 * 1_000_000, "detections": []}
        attacker.send("detections/unmounted", found | fields)


@attack
def invented_cameras_and_frames(attacker: Attacker) -> None:
    """The same messages in thousands of names; new names are refused for a while."""
    send_as_cameras(attacker, (f"c{number}" for number in range(attacker.names)))


def send_as_cameras(attacker: Attacker, names: Iterable[str]) -> None:
    """Send a detection, a calibration and a transform in each name."""
    _, info = attacker.hear("camera/*/info")
    _, pose = attacker.hear("transforms/*")
    heard_s = -math.inf
    for name in names:
        if time.monotonic() - heard_s > FRESH_S:
            _, found = attacker.hear("detections/*")
            heard_s = time.monotonic()
        frame = {"camera": name, "frame_id": f"{name}_optical"}
        attacker.send(f"detections/{name}", found | frame | {"detections": []})
        attacker.send(f"camera/{name}/info", info | frame)
        attacker.send(f"transforms/{name}", pose | {"child": name, "parent": f"p{name}"})


@attack
def heartbeats_of_others(attacker: Attacker) -> None:
    """Heartbeats in the name of real processes: stalled, stopping, of other process numbers."""
    heard = [attacker.hear(f"health/{name}/*") for name in ("detector", "tracker", "camera")]
    for number in range(18):  # each state with each process number, twice
        for key, health in heard:
            state = ("stalled", "stopping", "ready")[number % 3]
            pid = (1, health["pid"], number)[number // 3 % 3]
            attacker.send(key, health | {"state": state, "pid": pid, "reason": "forged"})
        time.sleep(0.05)


@attack
def invented_replicas(attacker: Attacker) -> None:
    """Tokens and heartbeats of detectors that do not exist, to which frames would be assigned."""
    _, health = attacker.hear("health/detector/*")
    liveliness = attacker.session.liveliness()
    names = [f"detector-{number}" for number in range(2, attacker.names + 2)]
    tokens = [liveliness.declare_token(f"{attacker.root}/alive/detector/{n}") for n in names]
    for _ in range(4):
        for name in names[:20]:
            attacker.send(f"health/detector/{name}", health | {"instance": name})
        time.sleep(0.5)
    del tokens


@attack
def answers_to_every_query(attacker: Attacker) -> None:
    """A server that answers all queries, the time among them, with false values."""
    served = 0

    def lie(query: Any) -> None:
        nonlocal served
        served += 1
        with query:
            for payload in (b"", b"\xc1" * 100, msgpack.packb({"clock": "x"})):
                query.reply(query.key_expr, payload)
            stamps = {"query_received_ns": served * HOUR_NS, "reply_sent_ns": served * HOUR_NS}
            query.reply(query.key_expr, msgpack.packb({"clock": "mine"} | stamps))

    server = attacker.session.declare_queryable(f"{attacker.root}/**", lie, complete=True)
    time.sleep(2.0)  # two queries of every process
    server.undeclare()  # type: ignore[no-untyped-call]


@attack
def queries_and_deletions_of_everything(attacker: Attacker) -> None:
    """Queries of all keys, and deletions of them."""
    for number in range(50):
        channel: Any = zenoh.handlers.RingChannel(1)
        attacker.session.get("people4d/**", channel, timeout=0.5)
        attacker.session.get(f"{attacker.root}/queries/clock", channel, timeout=0.5)
        attacker.session.delete(f"{attacker.root}/{TOPICS[number % len(TOPICS)]}")
        attacker.session.delete(f"{attacker.root}/**")


@attack
def a_flood_of_small_messages(attacker: Attacker) -> None:
    """As many messages as possible in a second, valid and invalid in turns."""
    key, tracks = attacker.hear("people")
    valid, end_s = msgpack.packb(tracks | {"camera": "other", "tracks": []}), time.monotonic() + 1
    while time.monotonic() < end_s:
        for _ in range(20):
            attacker.send(key, valid)
            attacker.send(f"{attacker.root}/detections/other", b"garbage")
        time.sleep(0.02)


@attack
def frames_with_thousands_of_people(attacker: Attacker) -> None:
    """Detections of another camera, with the maximum number of people, and with far more."""
    for number in range(4):
        _, found = attacker.hear("detections/*")
        person = (found["detections"] or [None])[0]
        if person is None:
            continue
        person |= {"mask": None, "keypoints": None}
        many = []
        for index in range(2000):
            position = array([index % 50 - 25.0, 0.0, 30.0 + index // 50])
            many.append(person | {"position_m": position})
        fields = {"camera": "other", "sequence": number, "trace": []}
        attacker.send("detections/other", found | fields | {"detections": many})
        attacker.send("detections/other", found | fields | {"detections": many[:DETECTIONS_MAX]})
        time.sleep(0.1)


@attack
def odd_keys(attacker: Attacker) -> None:
    """Long, foreign and deep keys, with valid messages."""
    _, health = attacker.hear("health/detector/*")
    _, tracks = attacker.hear("people")
    chunks = ["x" * 5000, "\u202e\u2066", "\x1b[2J", "..", "%00", "a b", "\U0001f468" * 50]
    for chunk in chunks:
        attacker.send(f"health/{chunk}/{chunk}", health)
        attacker.send(f"detections/{chunk}", tracks)
        attacker.send(f"camera/{chunk}/info", tracks)
        attacker.send("/".join(["people"] + [chunk] * 8), tracks)


@attack
def many_subscribers_come_and_go(attacker: Attacker) -> None:
    """Subscriptions to everything, with history, hundreds of times."""
    for _ in range(300):
        channel: Any = zenoh.handlers.RingChannel(1)
        subscriber: Any = attacker.session.declare_subscriber("people4d/**", channel)
        subscriber.undeclare()
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=100)
    several: list[Any] = [
        zenoh.ext.declare_advanced_subscriber(
            attacker.session, f"{attacker.root}/**", zenoh.handlers.RingChannel(1), history=history
        )
        for _ in range(20)
    ]
    time.sleep(1.0)
    for subscriber in several:
        subscriber.undeclare()


def main() -> int:
    """Run the attack named on the command line."""
    endpoint, robot, name, *names = sys.argv[1:]
    attacker = Attacker(endpoint, robot, int(names[0]) if names else NAMES)
    print(time.monotonic(), flush=True)
    ATTACKS[name](attacker)
    time.sleep(0.2)  # until the last message has left
    attacker.session.close()  # type: ignore[no-untyped-call]
    return 0


if __name__ == "__main__":
    sys.exit(main())
