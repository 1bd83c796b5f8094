"""Views of the chosen person and of other people, compared as a likelihood ratio."""

from collections.abc import Container

import msgspec

from common.appearance import NEAREST_VIEWS, REIDENTIFICATION_MAX, add_view, view_distance
from people4d.messages import F64

OTHERS_MAX = 16  # maximum number of other people with views
LIMIT_OTHER = 0.2  # maximum cosine distance of one person by an unknown embedder
# Shares of the maximum distance of one person, measured on rendered people who are dressed alike:
# distance at which the chosen person and an unknown one are equally likely (there 0.19), and
# distance that divides their ratio by e (0.02 to 0.03)
UNKNOWN, SCALE = 0.68, 0.08
RATIO_MAX = 5.0  # maximum logarithm of the likelihood ratio
LEARNT_RATIO_MIN = 1.0  # minimum logarithm of the ratio of a new view


class Appearance(msgspec.Struct):
    """Views by one embedder."""

    embedder: tuple[str, int] = ("", 0)  # name and length of the embeddings
    own: list[F64] = []  # views of the chosen person
    others: dict[int, list[F64]] = {}  # views of other people by track, oldest first

    def log_ratio(self, embedding: F64, elsewhere: Container[int], unknown: bool) -> float:
        """Return the log likelihood ratio of the chosen person to the likeliest other person.

        Args:
            embedding: Unit vector of the crop.
            elsewhere: Tracks of other people that cannot be in this crop.
            unknown: The crop may show an unknown person.
        """
        limit = REIDENTIFICATION_MAX.get(self.embedder[0], LIMIT_OTHER)
        own = view_distance(embedding, self.own, NEAREST_VIEWS)
        rivals = [
            view_distance(embedding, views, NEAREST_VIEWS)
            for track, views in self.others.items()
            if track not in elsewhere
        ]
        rivals += [UNKNOWN * limit] if unknown else []
        ratio = (min(rivals) - own) / (SCALE * limit) if rivals else RATIO_MAX
        return min(max(ratio, -RATIO_MAX), RATIO_MAX)

    def learn_own(self, embedding: F64) -> None:
        """Add a view of the chosen person, unless it resembles another person."""
        if not self.own or self.log_ratio(embedding, (), False) >= LEARNT_RATIO_MIN:
            add_view(self.own, embedding)

    def learn_other(self, track: int, embedding: F64) -> None:
        """Add a view of another person."""
        views = self.others.pop(track, [])
        add_view(views, embedding)
        self.others[track] = views  # the longest absent person is first
        if len(self.others) > OTHERS_MAX:
            del self.others[next(iter(self.others))]
