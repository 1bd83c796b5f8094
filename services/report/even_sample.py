"""A bounded sample, evenly spread over a stream of unknown length."""

from typing import Generic, TypeVar

T = TypeVar("T")


class EvenSample(Generic[T]):
    """Every k-th value; k doubles whenever twice the capacity is full.

    Once the capacity is reached, the sample has between one and two times the capacity.
    """

    def __init__(self, capacity: int) -> None:
        self.values: list[T] = []
        self.count = 0  # number of offered values
        self._capacity = capacity
        self._stride = 1

    @property
    def is_next(self) -> bool:
        """True if the next value is sampled."""
        return self.count % self._stride == 0

    def add_value(self, value: T) -> None:
        """Offer a value."""
        if self.is_next:
            self.values.append(value)
            if len(self.values) > 2 * self._capacity:
                self.values = self.values[::2]
                self._stride *= 2
        self.count += 1

    def skip(self) -> None:
        """Count a value that is not sampled, and need not be computed."""
        self.count += 1

    def pick(self, number: int) -> list[T]:
        """Return at most `number` values, evenly spread, including the first and last."""
        last = len(self.values) - 1
        if last < number:
            return list(self.values)
        if number == 1:
            return self.values[:1]
        return [self.values[round(k * last / (number - 1))] for k in range(number)]
