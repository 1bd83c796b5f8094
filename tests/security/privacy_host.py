"""One host of the test of privacy: the camera's with its router, or another one that listens.

    python -m tests.security.privacy_host camera ENDPOINT          # publishes until it is ended
    python -m tests.security.privacy_host listen ENDPOINT COUNT    # prints bytes by key as JSON

A listener subscribes to everything below people4d, and ends after a number of messages of tracks.
"""

import json
import os
import sys
import time
from collections import Counter

import numpy as np

from common.io.images import compress
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.messages import Message
from people4d.messages.people import Crop, Crops
from people4d.session import read_config as read_client
from tests import builders

ROBOT = "robot"


def published() -> list[Message]:
    """Return a message of each topic with images, and tracks last."""
    rgb = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    frame = builders.rgbd_frame(rgb=rgb, depth_mm=np.ones((48, 64), np.uint16))
    crops = Crops(stamp_ns=0, sequence=0, camera="front", crops=(Crop(detection=0, rgb=rgb),))
    return [frame, compress(frame), crops, builders.tracks(builders.track())]


def camera(endpoint: str) -> None:
    """Run a router and publish through it, as the services of a host do."""
    environment = dict(os.environ)
    _router = ZenohBus(
        read_config(None, "router", environment | {"PEOPLE4D_LISTEN": endpoint}), ROBOT
    )
    near = endpoint.replace("0.0.0.0", "127.0.0.1")
    bus = ZenohBus(read_config(None, "client", environment | {"PEOPLE4D_CONNECT": near}), ROBOT, 10)
    print("ready", flush=True)
    while True:
        for message in published():
            bus.publish(message)
        time.sleep(0.02)


def listen(endpoint: str, count: int) -> None:
    """Subscribe to everything without rules, and print bytes by key."""
    import zenoh  # noqa: PLC0415 (only here)

    heard: Counter[str] = Counter()
    tracks = 0
    config = read_client(None, "client", {"PEOPLE4D_CONNECT": endpoint}, "")
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("people4d/**")
        for sample in subscriber:
            heard[str(sample.key_expr)] += len(sample.payload.to_bytes())
            tracks += str(sample.key_expr).endswith("/people")
            if tracks >= count:
                break
    print(json.dumps(heard), flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "camera":
        camera(sys.argv[2])
    else:
        listen(sys.argv[2], int(sys.argv[3]))
