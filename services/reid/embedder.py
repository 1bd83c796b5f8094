"""What an embedder takes and gives."""

from collections.abc import Sequence
from typing import Protocol

from people4d.messages import F32, Crop


class Embedder(Protocol):
    """Turns pictures of people into vectors that are close for one person."""

    @property
    def name(self) -> str:
        """Name of the embedder; only vectors of one name compare."""
        ...

    @property
    def dimension(self) -> int:
        """Length of a vector."""
        ...

    def embed(self, crops: Sequence[Crop]) -> F32:
        """Embed pictures.

        Args:
            crops: N pictures.

        Returns:
            NxD, rows of unit length; cosine distance is 1 - a.b.
        """
        ...
