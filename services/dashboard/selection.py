"""Selection of shown frames before their messages are decoded.

Detections are selected at a rate, together with the frame and the tracks of the same camera and
stamp. Frames arrive before their detections, so their bytes are buffered.
"""

import threading
import time
from collections import OrderedDict, deque

import msgspec

FRAMES_MAX = 24  # maximum number of buffered frames of a camera
CAMERAS_MAX = 32  # maximum number of cameras
SELECTED_MAX = 256  # maximum number of remembered selections
SILENT_S = 1.0  # time without detections after which tracks are selected alone [s]
SLACK = 0.8  # minimum time between selections, in periods, since stamps jitter


class FrameHeader(msgspec.Struct, frozen=True):
    """Fields of a message that decide its selection."""

    camera: str
    stamp_ns: int


_HEADER = msgspec.msgpack.Decoder(FrameHeader)
Key = tuple[str, int]


class FrameSelection:
    """Selects frames by the bytes of their messages, from several threads.

    Args:
        rate_hz: Rate of selected frames of each camera [Hz].
    """

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.holds_frames = False  # True if a page shows images
        self._lock = threading.Lock()
        self._selected_s: dict[str, float] = {}  # monotonic time of the last selection, by camera
        self._detected_s = -1e9
        self._selected: OrderedDict[Key, None] = OrderedDict()
        self._frames: dict[str, deque[tuple[int, bytes]]] = {}
        self._tracks: deque[tuple[Key, bytes]] = deque(maxlen=32)
        self.tracks_passed = 0  # number of tracks since `count_tracks`

    def admits(self, name: str, payload: bytes) -> bool:
        """Check that a message of a topic is selected."""
        if name not in ("frames", "compressed", "detections", "people", "skeletons"):
            return True
        try:
            header = _HEADER.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return True  # counted as bad by the decoder
        with self._lock:
            return self._admits(name, (header.camera, header.stamp_ns), payload)

    def take_frame(self, key: Key) -> bytes | None:
        """Return the bytes of the frame of a camera and stamp, or None."""
        with self._lock:
            frames = self._frames.get(key[0], ())
            return next((payload for stamp_ns, payload in frames if stamp_ns == key[1]), None)

    def take_tracks(self, key: Key) -> bytes | None:
        """Return the bytes of tracks that arrived before their detections, or None."""
        with self._lock:
            return next((payload for one, payload in self._tracks if one == key), None)

    def count_tracks(self) -> int:
        """Return the number of messages of tracks since the last call."""
        with self._lock:
            count, self.tracks_passed = self.tracks_passed, 0
            return count

    def clear_frames(self) -> None:
        """Delete the buffered frames."""
        with self._lock:
            self._frames.clear()

    def _admits(self, name: str, key: Key, payload: bytes) -> bool:
        now_s = time.monotonic()
        if name in ("frames", "compressed"):
            if self.holds_frames and (key[0] in self._frames or len(self._frames) < CAMERAS_MAX):
                frames = self._frames.setdefault(key[0], deque(maxlen=FRAMES_MAX))
                frames.append((key[1], payload))
            return self.holds_frames and key in self._selected  # late frame
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
