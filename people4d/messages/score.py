"""Live scores of tracks against the truth (docs/method.md section 9)."""

from typing import Literal

from people4d.messages.base import Matrix4, Message, Name, Record, Text, Vector2


class PersonScore(Record, frozen=True, kw_only=True):
    """One true person in one frame and the track matched to them; errors are track minus truth."""

    id: Text  # identity in the truth
    # view of image and depth range; outside: not scored
    view: Literal["inside", "outside", "unknown"]
    track: int | None = None  # id of the matched track; absent if none
    predicted: bool = False  # True if the track was not matched to a detection in this frame
    switched: bool = False  # True if the last match of this person was another track
    # [m] x, y, frame: Score.frame_id; absent if no track
    position_error_m: Vector2 | None = None
    # [m/s] x, y, frame: Score.frame_id; absent if unknown
    velocity_error_mps: Vector2 | None = None
    yaw_error_rad: float | None = None  # [rad] in (-pi, pi]; absent if unknown in track or truth
    consistency: float | None = None  # share of the person's matches so far under the main track


class Tally(Record, frozen=True, kw_only=True):
    """Measures over several frames; a person outside the view is neither match nor miss."""

    frames: int  # number of compared frames
    duration_s: float  # [s] from the first compared frame to the last
    truths: int  # number of true people in view, over all frames
    matched: int  # number of truths with a track within the gate
    predicted: int  # number of matches with a track without a detection in its frame
    outside: int  # number of people out of view, over all frames; not in truths
    false_alarms: int  # number of unmatched tracks, over all frames
    id_switches: int  # number of matches of a person to another track than before
    position_rmse_m: float | None = None  # [m] of the horizontal distance
    velocity_rmse_mps: float | None = None  # [m/s] horizontal; absent if the truth has none
    yaw_rmse_rad: float | None = None  # [rad] of min(|e|, 2 pi - |e|); absent if unknown
    yaw_correlation: float | None = None  # Mardia's circular correlation, -1 to 1


class Alignment(Record, frozen=True, kw_only=True):
    """Clock offset and transform between truth and tracks: estimates, not calibrations."""

    applied: bool  # True: errors are given after this alignment
    clock_offset_s: float | None = None  # [s] to add to stamps of the truth; absent: not observable
    # [s] standard deviation of the clock offset for independent errors
    clock_sigma_s: float | None = None
    # [m] homogeneous, tracks_from_truth; absent if unknown
    matrix: Matrix4 | None = None
    rmse_before_m: float | None = None  # [m] horizontal, with the clock offset but not the matrix
    rmse_after_m: float | None = None  # [m] horizontal, with both


class Score(Message, frozen=True, kw_only=True):
    """Tracks against the truth interpolated to their stamp: this frame, the last 10 s, in total."""

    frame_id: Name  # frame of tracks and truth
    camera: Name  # camera whose frame was scored
    people: tuple[PersonScore, ...] = ()  # all people of the truth
    false_alarms: tuple[int, ...] = ()  # ids of unmatched tracks
    recent: Tally  # the last 10 s
    total: Tally  # tally since playback began
    id_consistency: float | None = None  # ratio of all matches under each person's main track
    alignment: Alignment | None = None  # absent unless configured
