"""Messages as JSON, for programs without MessagePack."""

import msgspec
import numpy as np

from people4d.messages import Message


def to_json(message: Message, robot: str) -> bytes:
    """Return the fields of a message without its trace, and the robot; infinity is null."""
    fields = msgspec.to_builtins(message, enc_hook=np.ndarray.tolist)
    fields.pop("trace")
    return msgspec.json.encode({"robot": robot, **fields})
