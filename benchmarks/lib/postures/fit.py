"""Means and deviations of the states of postures, fitted to labelled frames of simulated people."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.lib.postures.run import TORSO, frames, true_posture
from lab.world import World
from people4d.messages import F64
from people4d.messages.skeleton import POSTURES
from services.skeleton.observation import observe_joints
from services.skeleton.posture import MEANS, READ, SIGMAS, STATES, observe_posture
from services.skeleton.skeletons import People

READINGS_MIN = 20  # minimum number of readings of a fitted mean
BODIES = 0.1  # standard deviation between simulated and real bodies, in each column
WIDER = 1.5  # factor of the deviations, for poses between the simulated ones


def labelled_frames(world: World) -> Iterator[tuple[int, F64]]:
    """Yield the posture's number and the observation of people at rest; NaN without a reading."""
    standing_m = [float(person[TORSO, 2].mean()) for person in world.keypoints_m(0.0)]
    for frame in frames(world):
        for person, track in enumerate(frame.tracks):
            label = true_posture(world, person, frame.time_s)
            if track is None or label is None:
                continue
            pose = world.map_from_optical(frame.time_s)
            joints = observe_joints([frame.detections.at(track.detection)], world.info, pose)
            values, variances = observe_posture(People.from_tracks([track]), joints)
            row = np.where(variances[0] < READ, values[0], np.nan)
            yield POSTURES.index(label), np.append(row, standing_m[person] - track.position_m[2])


def fit(samples: Sequence[tuple[int, F64]], rounds: int = 10) -> tuple[F64, F64]:
    """Return the means of all states, and the common deviations of all but the last.

    Each frame belongs to the nearest state of its posture.
    """
    labels, values = np.array([one[0] for one in samples]), np.stack([one[1] for one in samples])
    means, others = MEANS.copy(), labels[:, None] != np.array(STATES[:-1])
    spreads = np.full((len(STATES) - 1, values.shape[1]), np.nan)
    for _ in range(rounds):
        away = np.nan_to_num((values[:, None] - means[:-1]) / SIGMAS[:-1])
        nearest = np.where(others, np.inf, (away**2).sum(axis=2)).argmin(axis=1)
        for state in range(len(STATES) - 1):
            for column, read in enumerate(values[nearest == state].T):
                found = read[np.isfinite(read)]
                if len(found) >= READINGS_MIN:
                    means[state, column], spreads[state, column] = found.mean(), found.std()
    return means, WIDER * np.sqrt(np.nanmean(spreads**2, axis=0) + BODIES**2)
