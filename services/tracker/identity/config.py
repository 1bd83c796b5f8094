"""Configuration of what StrongSORT-3D does beyond the paper to keep identities."""

import math

import msgspec


class OcclusionConfig(msgspec.Struct, frozen=True, kw_only=True):
    """People hidden behind others, or whom the camera turns away from, keep their tracks.

    All values are this project's.
    """

    enabled: bool = False  # section 5: False
    # [m] half of a person's width: who stands before whom is told by such upright strips
    half_width_m: float = 0.25
    # Share of the strip of a person that nearer people must cover for them to count as hidden
    covered_min: float = 0.4
    # [m] someone seen hides a person who is not nearer to the camera than they by more than this:
    # of two who touch, one is often found for both
    nearer_slack_m: float = 0.2
    # A camera has turned away from somebody if it shows less than this share of what it showed of
    # their width where they were seen last: that they are not seen says nothing then
    watched_min: float = 0.5
    # A person not seen may stop or turn: their velocity dies out with this time constant, and its
    # uncertainty goes back to that of somebody walking anywhere
    velocity_decay_s: float = 0.7  # [s]
    walk_sigma_mps: float = 0.6  # [m/s] standard deviation of a walking person's velocity, each way

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(self, "half_width_m", "velocity_decay_s", "walk_sigma_mps")
        _expect_within(self, 1.0, "covered_min", "watched_min")
        _expect_within(self, 10.0, "nearer_slack_m")


class ContactConfig(msgspec.Struct, frozen=True, kw_only=True):
    """People who cross or touch keep their own tracks. All values are this project's."""

    enabled: bool = False  # section 5: False
    # Share of a box that another box covers, above which its picture shows others, too: it does not
    # change what a track looks like. Nor does one cut off at the left or right of the image
    covered_max: float = 0.3
    # Share of a track's strip that a detection covers if it could be of that track; a picture that
    # could be of several tracks is not clear
    shared_min: float = 0.5
    crowded_factor: float = 2.0  # by which its cosine distances are divided: position decides
    # A picture that others cover by more than this has the depth of whoever covers it, maybe: its
    # position counts across the line of sight, and along it with this standard deviation more
    doubt_covered: float = 0.35
    doubt_sigma_m: float = 1.0  # [m]; 0: never
    # Nobody is farther from where they are predicted than this, plus so much for each second that
    # they were not seen; the gate of section 5 lets people jump 1.6 m from one frame to the next
    jump_m: float = 0.4  # [m] on the ground
    speed_max_mps: float = 2.5  # [m/s]
    # Tracks whose looks differ by less than this many times C_cos are told apart by position only
    alike_factor: float = 0.5
    # A picture that is not clear may differ by this many times C_cos: position decides
    unclear_factor: float = 1.2
    # Round 2 refuses who looks different by more than this many times C_cos, so that a newcomer
    # does not get the track of somebody who was there a moment ago
    round2_factor: float = 1.5

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_within(self, 1.0, "covered_max", "doubt_covered")
        _expect_within(self, 10.0, "doubt_sigma_m")
        _expect_positive(self, "unclear_factor", "round2_factor", "jump_m", "speed_max_mps")
        _expect_within(self, 1.0, "alike_factor")


class IdentityConfig(msgspec.Struct, frozen=True, kw_only=True):
    """People who left are known again when they come back. All values are this project's."""

    enabled: bool = False  # section 5: False
    # What is kept of each person
    views: int = 8  # embeddings of one person, as different from each other as can be
    view_gap: float = 0.03  # cosine distance from which an embedding is another view
    score_min: float = 0.4  # least confidence of a detection that is looked at
    identities: int = 100  # people remembered; whoever was not seen for longest is forgotten first
    keep_s: float = 600.0  # [s] since somebody was seen that they are remembered
    # [s] Whoever was not seen for longer, and was never hidden, is known again only as somebody who
    # comes back, with a margin to all others, not as the nearest track that looks like them
    handover_s: float = 1.0
    # [s] The same for whoever was cut off at the left or right of the image when last seen
    leaving_s: float = 0.3
    # When it is decided who somebody is
    evidence: int = 2  # clear pictures of a newcomer that are waited for, ...
    wait_s: float = 0.5  # [s] ... for so long at most, while somebody could be back
    # How it is decided
    match_max: float | None = None  # largest cosine distance of the same person; absent: C_cos
    margin: float = 0.05  # by so much anybody else must look more different
    temperature: float = 0.04  # cosine distance that makes something e times less likely
    speed_max_mps: float = 2.5  # [m/s] nobody moves faster while out of sight
    jump_m: float = 0.8  # [m] errors of positions on top of that

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(self, "views", "identities", "keep_s", "evidence", "temperature")
        _expect_positive(self, "speed_max_mps")
        _expect_within(self, 1.0, "score_min")
        _expect_within(self, 2.0, "view_gap", "margin")
        _expect_within(self, 60.0, "wait_s", "jump_m", "handover_s", "leaving_s")
        if self.match_max is not None and not 0 < self.match_max <= 2:
            raise ValueError(f"match_max: expected above 0, at most 2, got {self.match_max}")


def _expect_positive(record: msgspec.Struct, *fields: str) -> None:
    for field in fields:
        value = getattr(record, field)
        if not 0 < value < math.inf:
            raise ValueError(f"{field}: expected a finite number > 0, got {value}")


def _expect_within(record: msgspec.Struct, most: float, *fields: str) -> None:
    for field in fields:
        value = getattr(record, field)
        if not 0 <= value <= most:
            raise ValueError(f"{field}: expected 0 to {most:g}, got {value}")
