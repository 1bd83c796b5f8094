"""Interface of trackers that exchange people with neighbouring areas."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from services.tracker.interface import GalleryEntry


@dataclass(frozen=True, slots=True)
class KnownPeople:
    """People that a tracker can recognise."""

    embedder: str  # name of the model of the views
    entries: Mapping[int, GalleryEntry]  # people by identity


class AreaTracker(ABC):
    """A tracker that hands identities over between areas."""

    @abstractmethod
    def known_people(self) -> KnownPeople | None:
        """Return the people of the gallery; None if re-identification is off."""

    @abstractmethod
    def learn_neighbours(self, people: Mapping[int, GalleryEntry]) -> None:
        """Replace the people of neighbouring areas, by identity."""

    @abstractmethod
    def rename(self, identities: Mapping[int, int | None]) -> None:
        """Change the identities of tracks to the identities of neighbours for the same people.

        A track gets a new identity if its value is None: a neighbour tracks another person under
        it.
        """
