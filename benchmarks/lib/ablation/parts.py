"""Parts of `best` beyond the source works, and rules that were deleted."""

from dataclasses import dataclass

STRONG = "tracker.strongsort3d"


@dataclass(frozen=True)
class Part:
    """One part of `best`."""

    settings: tuple[str, ...]  # settings that disable the part
    source: str = ""  # source of a published part

    @property
    def is_tracker(self) -> bool:
        """True if detections are the same without the part."""
        return all(one.startswith("tracker.") for one in self.settings)


PARTS = {
    "body network": Part(("detector.position=keypoints",)),
    "measured covariance": Part((f"{STRONG}.noise=constant",)),
    "orientation network": Part(("detector.orientation.network=",)),
    "joint orientation": Part(("detector.orientation.method=separate",)),
    "density of yaw": Part(("tracker.yaw=kalman",)),
    "visibility": Part((f"{STRONG}.visibility=false",)),
    "identity": Part((f"{STRONG}.identity.enabled=false",)),
    "life cycle by hits": Part((f"{STRONG}.lifetime=streak", f"{STRONG}.n_init=3")),
    "standing model": Part((f"{STRONG}.standing_model=false",), "IMM [Blom 1988]"),
    "acceleration": Part((f"{STRONG}.sigma_acceleration_mps2=0.5",)),
}

NO_GAIN = "no figure is worse without it beyond its interval"
# Rules that are deleted, by the commit that deleted them, and the reason
DELETED = {
    "a0dbe86a": (
        ("margin of identities", NO_GAIN),
        ("covered crops", NO_GAIN),
        ("walking distance of returning people", NO_GAIN),
        ("yaw from walking", NO_GAIN),
        ("reversal of yaw by side", NO_GAIN),
        ("gates of round 2", NO_GAIN),
        ("displacement limit", NO_GAIN),
        ("weight of measured velocities", NO_GAIN),
        ("motion weight of its own", NO_GAIN),
    ),
    "73a2fe92": (
        ("people beyond the range of depth", NO_GAIN),
        ("boxes on two people", NO_GAIN),
    ),
    "98a1de29": (("measured velocity", NO_GAIN),),
    "9d866fbd": (("yaw by depths of shoulders and hips, and by hips", NO_GAIN),),
    "6c0e6fd9": (("likelihood in round 1", "IDF1 +0.8 % [+0.1, +1.6] without it"),),
}
