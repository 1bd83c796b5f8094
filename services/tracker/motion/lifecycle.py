"""Life cycle of tracks: confirmation and deletion (docs/method.md, section 5)."""

from dataclasses import dataclass

from services.tracker.motion.track_record import TrackRecord

MISSES_MIN = 2  # minimum number of missed frames, hidden ones included, that end a track
SEVERAL_HITS = 1  # additional matches for confirmation with several cameras
# Minimum mean log-odds of a person for confirmation. Single detections in simulated rooms have less
# in 0 % (people), 94 % (posters), 92 % (robots) and 98 % (furniture).
PERSON_MIN = -2.5
ABSENCE_MAX_S = 30.0  # maximum outage of frames that tracks survive [s]
TENTATIVE_S = 1.0  # maximum age of an unmatched tentative track with several cameras [s]


@dataclass(frozen=True, slots=True)
class Lifecycle:
    """Confirmation by consecutive matches, deletion by unmatched frames [Wojke 2017]."""

    confirm_hits: int  # number of matches, including the first, for confirmation
    tentative_frames: int  # number of unmatched frames that end a tentative track
    lost_frames: int  # number of unmatched frames that end a confirmed track
    lost_s: float  # [s] maximum time without a match of any track

    def bridges(self, absent_s: float) -> bool:
        """Return True if tracks survive an outage of frames longer than `lost_s`."""
        return self.lost_s < absent_s <= ABSENCE_MAX_S

    def confirms(self, record: TrackRecord, several_cameras: bool) -> bool:  # noqa: ARG002
        """Return True after enough matches."""
        return record.streak >= self.confirm_hits

    def ended(self, record: TrackRecord) -> bool:
        """Return True after too many unmatched frames; hidden ones do not count."""
        limit = self.lost_frames if record.confirmed else self.tentative_frames
        return record.frames_missed >= limit

    def expired(self, record: TrackRecord, stamp_ns: int, several_cameras: bool) -> bool:  # noqa: ARG002
        """Return True after too long a time without a match."""
        return stamp_ns - record.matched_ns > self.lost_s * 1e9


class HitsLifecycle(Lifecycle):
    """Confirmation by matches, consecutive or not; deletion after an equal number of misses.

    Several cameras give more matches in less time, and more false alarms.
    """

    def confirms(self, record: TrackRecord, several_cameras: bool) -> bool:
        """Return True after enough matches, unless their images show something else."""
        enough = record.hits >= self.confirm_hits + SEVERAL_HITS * several_cameras
        return enough and record.person_log_odds >= PERSON_MIN

    def ended(self, record: TrackRecord) -> bool:
        """Return True if misses reach the hits, or with hidden frames their square.

        A track of one or two matches is often a false alarm.
        """
        if record.missed >= max(record.hits**2, MISSES_MIN):
            return True
        return record.frames_missed >= min(self.lost_frames, record.hits)

    def expired(self, record: TrackRecord, stamp_ns: int, several_cameras: bool) -> bool:
        """Return True after too long a time without a match.

        A false alarm behind a person counts as hidden, so that misses do not end it.
        """
        limit_s = TENTATIVE_S if several_cameras and not record.confirmed else self.lost_s
        return stamp_ns - record.matched_ns > limit_s * 1e9
