"""Selection of the frames that are shown, before their messages are decoded.

Detections are selected at a rate; the frame and the tracks of the same camera and stamp belong to
them. Frames come before their detections, so their bytes are held for a moment.
"""

import threading
import time
from collections import OrderedDict, deque

import msgspec

FRAMES_MAX = 24  # undecoded frames of a camera that are held
CAMERAS_MAX = 32
SELECTED_MAX = 256
SILENT_S = 1.0  # without detections, after which tracks are selected by themselves
SLACK = 0.8  # of the period: stamps are not quite regular


class FrameHeader(msgspec.Struct, frozen=True):
    """Fields of a message by which it is selected."""

    camera: str
    stamp_ns: int


_HEADER = msgspec.msgpack.Decoder(FrameHeader)
Key = tuple[str, int]


class FrameSelection:
    """Selects frames by the bytes of their messages; used by several threads.

    Args:
        rate_hz: Frames selected a second, of each camera.
    """

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.holds_frames = False  # somebody wants to see images
        self._lock = threading.Lock()
        self._selected_s: dict[str, float] = {}  # monotonic, by camera
        self._detected_s = -1e9
        self._selected: OrderedDict[Key, None] = OrderedDict()
        self._frames: dict[str, deque[tuple[int, bytes]]] = {}
        self._tracks: deque[tuple[Key, bytes]] = deque(maxlen=32)
        self.tracks_passed = 0  # tracks that came since `count_tracks`

    def admits(self, name: str, payload: bytes) -> bool:
        """Check that a message of a topic is to be decoded."""
        if name not in ("frames", "compressed", "detections", "people", "skeletons"):
            return True
        try:
            header = _HEADER.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return True  # it is counted as bad where it is decoded
        with self._lock:
            return self._admits(name, (header.camera, header.stamp_ns), payload)

    def take_frame(self, key: Key) -> bytes | None:
        """Return the bytes of the frame of a camera and stamp, None if it is not there."""
        with self._lock:
            frames = self._frames.get(key[0], ())
            return next((payload for stamp_ns, payload in frames if stamp_ns == key[1]), None)

    def take_tracks(self, key: Key) -> bytes | None:
        """Return the bytes of tracks that came before their detections, None if none did."""
        with self._lock:
            return next((payload for one, payload in self._tracks if one == key), None)

    def count_tracks(self) -> int:
        """Return how many messages of tracks came since the last call."""
        with self._lock:
            count, self.tracks_passed = self.tracks_passed, 0
            return count

    def clear_frames(self) -> None:
        """Forget frames that no page shows any more."""
        with self._lock:
            self._frames.clear()

    def _admits(self, name: str, key: Key, payload: bytes) -> bool:
        now_s = time.monotonic()
        if name in ("frames", "compressed"):
            if self.holds_frames and (key[0] in self._frames or len(self._frames) < CAMERAS_MAX):
                frames = self._frames.setdefault(key[0], deque(maxlen=FRAMES_MAX))
                frames.append((key[1], payload))
            return self.holds_frames and key in self._selected  # it comes late
        if name == "skeletons":
            return key in self._selected
        if name == "people":
            self.tracks_passed += 1
            if key in self._selected:
                return True
            if now_s - self._detected_s < SILENT_S:
                self._tracks.append((key, payload))
                return False
        else:
            self._detected_s = now_s
        return self._is_due(key, now_s)

    def _is_due(self, key: Key, now_s: float) -> bool:
        if now_s - self._selected_s.get(key[0], -1e9) < SLACK / self.rate_hz:
            return False
        if key[0] not in self._selected_s and len(self._selected_s) >= CAMERAS_MAX:
            return False
        self._selected_s[key[0]] = now_s
        self._selected[key] = None
        while len(self._selected) > SELECTED_MAX:
            self._selected.popitem(last=False)
        return True
