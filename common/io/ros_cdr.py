"""Messages of ROS 2 in CDR, on keys as zenoh-bridge-ros2dds forwards them."""

import re
from collections.abc import Callable
from typing import Any, TypeVar

from rosbags.typesys.store import Typestore

from people4d.errors import ConfigError, DecodeError

T = TypeVar("T")

SCHEME = "zenoh:"
# Chunks without wild cards of Zenoh, blanks, or characters that names of ROS topics lack.
KEY = re.compile(r"[A-Za-z0-9_~.%@-]{1,64}(/[A-Za-z0-9_~.%@-]{1,64}){0,31}")
MAX_BYTES = 2**20


def parse_key(field: str, text: str, example: str) -> str:
    """Return the key in "zenoh:KEY", as of the ROS topic /KEY; ConfigError if it is none."""
    key = text.removeprefix(SCHEME).strip("/")
    if not KEY.fullmatch(key):
        raise ConfigError(
            f"{field} {text!r:.80} is not a key",
            f"Write zenoh: and the ROS topic, for example {SCHEME}{example}.",
        )
    return key


def cdr_decoder(store: Typestore, kind: str, make: Callable[[Any], T]) -> Callable[[bytes], T]:
    """Return the decoder of one type of message in CDR, whose bytes are untrusted.

    It raises DecodeError if they are no such message, or if `make` cannot use the message.
    """

    def decode(payload: bytes) -> T:
        if len(payload) > MAX_BYTES:
            raise DecodeError(f"{kind}: expected at most {MAX_BYTES} bytes, got {len(payload)}")
        try:
            return make(store.deserialize_cdr(payload, kind))
        except DecodeError:
            raise
        except Exception as error:  # damaged bytes make rosbags raise almost anything
            reason = f"{type(error).__name__} {error}"[:80].strip()
            raise DecodeError(f"expected {kind} in CDR, got {reason}") from error

    return decode
