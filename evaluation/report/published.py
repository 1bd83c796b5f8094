"""Published results: reference points, measured elsewhere on other data.

Intel NUC 11 (i5-1135G7), seven recordings of about one minute with 2 to 4 people in 3.5 x 5.5 m,
motion capture as truth. Its x axis runs across the view of the camera, its y axis along it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

SOURCE = "published: other recordings, of real people, Intel NUC 11"


@dataclass(frozen=True)
class PublishedResult:
    """Published results of one method."""

    method: str  # name in the publication
    metrics: Mapping[str, float]  # by our names; shares 0 to 1
    # metrics by number of people, as far as they are published
    by_people: Mapping[int, Mapping[str, float]]


def _published(
    method: str,
    switches: tuple[float, ...],
    errors: tuple[tuple[float, ...], ...],
    rates_hz: tuple[float, ...],
) -> PublishedResult:
    position, velocity, yaw = errors
    metrics = {
        "id_switches_per_min": switches[0],
        "position_rmse_across_m": position[0],
        "position_rmse_along_m": position[1],
        "velocity_rmse_across_mps": velocity[0],
        "velocity_rmse_along_mps": velocity[1],
        "yaw_rmse_deg": yaw[0],
        "yaw_correlation": yaw[1],
        "rate_hz": rates_hz[0],
    }
    for name, limits, unit, shares in (
        ("position", (0.15, 0.3, 0.5), "m", position[2:]),
        ("velocity", (0.15, 0.3, 0.5), "mps", velocity[2:]),
        ("yaw", (30, 45, 90), "deg", yaw[2:]),
    ):
        for limit, share in zip(limits, shares, strict=True):
            metrics[f"{name}_within_{limit}_{unit}"] = share / 100
    by_people = {
        people: {"id_switches_per_min": switches[k], "rate_hz": rates_hz[k]}
        for k, people in enumerate((2, 3, 4), 1)
    }
    return PublishedResult(method, metrics, by_people)


# Switches and rates: all, 2, 3, 4 people. Errors: two axes, then success rates in percent; yaw:
# error, correlation, success rates.
PUBLISHED = (
    _published(
        "YOLOv8s-seg + SORT-3D",
        (8.6, 3.1, 6.5, 17.2),
        (
            (0.150, 0.308, 8.4, 63.4, 84.0),
            (0.178, 0.258, 47.3, 83.8, 93.5),
            (44.4, 0.739, 52.6, 70.6, 94.8),
        ),
        (22.9, 23.1, 23.2, 22.4),
    ),
    _published(
        "YOLOv8s-seg + StrongSORT-3D",
        (2.5, 1.5, 0.7, 6.5),
        (
            (0.160, 0.300, 18.1, 52.6, 88.2),
            (0.213, 0.272, 21.2, 60.4, 90.7),
            (61.9, 0.535, 33.9, 48.5, 86.3),
        ),
        (18.6, 19.8, 18.7, 17.3),
    ),
    _published(
        "YOLOv8s-pose + StrongSORT-3D",
        (2.1, 1.0, 0.3, 6.0),
        (
            (0.165, 0.283, 20.1, 58.4, 90.1),
            (0.222, 0.285, 21.2, 60.6, 90.2),
            (32.3, 0.801, 70.6, 85.2, 97.8),
        ),
        (22.7, 24.1, 23.0, 21.0),
    ),
)
