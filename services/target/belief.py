"""Belief of which track is the chosen person: exclusive hypotheses, absence included.

Continuity gives each track a prior probability. Close tracks exchange their people at a rate that
falls with their distance, a track that was not matched for a while goes on with another person, and
the absent person may be on a new track. Crops give the likelihood ratio. Crops of one track repeat
each other: measured on rendered people, the mean of 20 crops distinguishes two people no better
than one crop. Hence the mean ratio of the last crops counts, not their sum.
"""

import itertools
import math
from collections.abc import Mapping

import msgspec

PRIOR_MAX = 0.9975  # maximum prior probability of a track
EXCHANGE_HZ = 5.0  # rate at which two tracks at one place exchange their people [1/s]
EXCHANGE_M = 0.35  # distance that divides the rate of exchanges by e [m]
CONTACT_M = 0.7  # maximum distance of two tracks that may exchange their people [m]
UNMATCHED_NS = 300_000_000  # minimum gap of a track in which it may change to another person [ns]
UNMATCHED_S = 5.0  # time constant of the change of an unmatched track to another person [s]
ARRIVAL = 0.5  # probability that a new track is the absent person
ARRIVAL_NAMED = 0.2  # probability that a new track is an enrolled person, before the first lock
CROPS = 10  # number of crops in the mean


class TrackBelief(msgspec.Struct):
    """Prior probability that one track is the chosen person, and the evidence of its crops."""

    age: int  # [frames] of the track
    matched_ns: int  # [ns] last match
    prior: float = 0.0
    evidence: float = 0.0  # mean log ratio of the last crops since a chance of an exchange
    crops: int = 0  # number of crops that counted
    crop_ns: int = 0  # [ns] stamp of the last crop that counted
    ratio: float = 0.0  # log ratio of the crop
    contact: bool = False  # True: close to a track with which it may be exchanged

    def add_ratio(self, ratio: float) -> None:
        """Add the log ratio of a crop."""
        self.crops = min(self.crops + 1, CROPS)
        self.evidence += (ratio - self.evidence) / self.crops
        self.ratio = ratio

    def forget_crops(self) -> None:
        """Forget the evidence of the crops after a chance of an exchange."""
        self.crops, self.evidence, self.ratio = 0, 0.0, 0.0

    def match(self, stamp_ns: int, arrival: float) -> None:
        """Count a match; after a gap the track may go on with another person.

        Args:
            stamp_ns: Stamp of the frame.
            arrival: Probability that another person is the chosen one.
        """
        gap_ns, self.matched_ns = stamp_ns - self.matched_ns, stamp_ns
        if gap_ns > UNMATCHED_NS:
            other = 1 - math.exp(-gap_ns / 1e9 / UNMATCHED_S)
            self.prior += other * (arrival - self.prior)
            self.forget_crops()


def absence(tracks: Mapping[int, TrackBelief]) -> float:
    """Return the prior probability that the chosen person is on no track."""
    return max(1.0 - sum(one.prior for one in tracks.values()), 0.0)


def posterior(tracks: Mapping[int, TrackBelief]) -> dict[int, float]:
    """Return the probability of each track."""
    odds = {track: one.prior * math.exp(one.evidence) for track, one in tracks.items()}
    total = absence(tracks) + sum(odds.values())
    return {track: one / total if total else 0.0 for track, one in odds.items()}


def settle(tracks: Mapping[int, TrackBelief], chosen: int) -> None:
    """Make one track the chosen person beyond doubt."""
    for track, one in tracks.items():
        one.prior = PRIOR_MAX if track == chosen else 0.0


def spread(tracks: Mapping[int, TrackBelief], arrival: float) -> None:
    """Make all tracks and absence equally likely: any exchange is possible.

    Args:
        tracks: All tracks.
        arrival: Probability that a new track is the absent person, the limit of each track.
    """
    for one in tracks.values():
        one.prior = min(arrival, 1.0 / (len(tracks) + 1))
        one.forget_crops()


def exchange(
    tracks: Mapping[int, TrackBelief], positions_m: Mapping[int, tuple[float, float]], step_s: float
) -> None:
    """Exchange the prior probabilities of close tracks."""
    contacts = set[int]()
    for a, b in itertools.combinations(positions_m, 2):
        apart_m = math.dist(positions_m[a], positions_m[b])
        if apart_m >= CONTACT_M:
            continue
        contacts |= {a, b}
        rate_hz = EXCHANGE_HZ * math.exp(-((apart_m / EXCHANGE_M) ** 2))
        share = 0.5 * (1 - math.exp(-2 * rate_hz * step_s))
        first, second = tracks[a], tracks[b]
        moved = share * (first.prior - second.prior)
        first.prior -= moved
        second.prior += moved
    for track, one in tracks.items():
        if (track in contacts) != one.contact:
            one.contact = track in contacts
            one.forget_crops()
