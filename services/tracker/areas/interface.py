"""Interface of trackers that exchange people with neighbouring areas."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from services.tracker.interface import GalleryEntry


@dataclass(frozen=True, slots=True)
class KnownPeople:
    """People that a tracker can recognise."""

    embedder: str  # name of the model of their views
    entries: Mapping[int, GalleryEntry]  # by identity


class AreaTracker(ABC):
    """A tracker that can hand identities over between areas."""

    @abstractmethod
    def known_people(self) -> KnownPeople | None:
        """Return the people that it can recognise; None if re-identification is off."""

    @abstractmethod
    def learn_neighbours(self, people: Mapping[int, GalleryEntry]) -> None:
        """Take the people of neighbouring areas by identity, in place of those before."""

    @abstractmethod
    def rename(self, identities: Mapping[int, int | None]) -> None:
        """Give tracks the identities that neighbours have for the same people.

        None: another person elsewhere has the identity, and the track gets a new one.
        """
