"""People around a robot: messages, topics, codec and client of a running system.

for message in people4d.subscribe("tcp/192.168.1.7:7447"):
    print([track.position_m for track in message.tracks])
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from people4d.client import Client, subscribe
    from people4d.errors import ConfigError, DecodeError, People4dError
    from people4d.messages import (
        JOINTS,
        CameraInfo,
        Event,
        Gait,
        Health,
        ImageTrack,
        ImageTracks,
        Message,
        PersonGait,
        PersonPrediction,
        PersonSkeleton,
        Predictions,
        Skeletons,
        StaticTransform,
        Target,
        TargetCommand,
        Track,
        Tracks,
        Zone,
        Zones,
    )

__all__ = [
    "JOINTS",
    "CameraInfo",
    "Client",
    "ConfigError",
    "DecodeError",
    "Event",
    "Gait",
    "Health",
    "ImageTrack",
    "ImageTracks",
    "Message",
    "People4dError",
    "PersonGait",
    "PersonPrediction",
    "PersonSkeleton",
    "Predictions",
    "Skeletons",
    "StaticTransform",
    "Target",
    "TargetCommand",
    "Track",
    "Tracks",
    "Zone",
    "Zones",
    "subscribe",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use: only the client needs Zenoh."""
    if name not in __all__:
        raise AttributeError(f"module 'people4d' has no attribute {name!r}")
    client, errors = name in ("Client", "subscribe"), name.endswith("Error")
    home = "client" if client else "errors" if errors else "messages"
    return getattr(import_module(f"people4d.{home}"), name)


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
