"""Views: the embeddings by which a person is recognised."""

from collections.abc import Sequence

import numpy as np

from people4d.messages import F64

# Maximum cosine distances of one person at 2 % false matches, measured on rendered crops; for the
# appearance network also on crops of real people
REIDENTIFICATION_MAX = {"appearance": 0.28, "histogram": 0.15, "osnet": 0.38}
# Cosine distance that divides the odds of a match by e, fitted to crops of simulated and real
# people: 0.046 with the appearance network, 0.045 with OSNet, 0.052 with the histogram
TEMPERATURE = 0.047
VIEWS_MAX = 8  # maximum number of embeddings of a person, chosen to differ
VIEW_GAP = 0.03  # minimum cosine distance of two views
NEAREST_VIEWS = 2  # number of nearest views in a distance: a single one may be a bad crop


def view_distance(embedding: F64, views: Sequence[F64], count: int = 1) -> float:
    """Return the mean cosine distance to a number of nearest views."""
    nearest = np.sort(1.0 - np.array(views) @ embedding)[:count]
    return min(max(float(nearest.mean()), 0.0), 2.0)


def add_view(views: list[F64], embedding: F64) -> None:
    """Add an embedding that differs from all others by more than VIEW_GAP.

    Beyond VIEWS_MAX, the older of the two most similar views is deleted.
    """
    if views and view_distance(embedding, views) <= VIEW_GAP:
        return
    views.append(embedding)
    if len(views) > VIEWS_MAX:
        similarity = np.asarray(views) @ np.asarray(views).T
        np.fill_diagonal(similarity, -np.inf)
        first, second = np.unravel_index(int(np.argmax(similarity)), similarity.shape)
        del views[int(min(first, second))]
