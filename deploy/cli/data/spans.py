"""Part of a recording, by the options --start and --end."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import typer

from common.io.recording import Recording
from people4d.errors import ConfigError
from people4d.messages import Message

Start = Annotated[
    float, typer.Option("--start", min=0.0, help="Seconds from the beginning to start at.")
]
End = Annotated[
    float | None,
    typer.Option("--end", min=0.0, help="Seconds from the beginning to end at; default: the end."),
]


@dataclass(frozen=True)
class RecordingSpan:
    """Part of a recording; ConfigError if its end is before its start."""

    start_s: float = 0.0  # [s] start, from the first message
    end_s: float | None = None  # [s] end, from the first message; None: at the last one

    def __post_init__(self) -> None:
        """Check the order."""
        if self.end_s is not None and self.end_s < self.start_s:
            raise ConfigError(f"--end {self.end_s:g} lies before --start {self.start_s:g}")

    def check(self, recording: Recording) -> None:
        """Check that the part begins within the recording; ConfigError otherwise."""
        duration_s = recording.summary.duration_s
        if self.start_s > duration_s:
            raise ConfigError(
                f"--start {self.start_s:g} lies after the end of the recording",
                f"It is {duration_s:.1f} s long.",
            )

    def messages(
        self, recording: Recording, *types: type[Message]
    ) -> Iterator[tuple[int, Message]]:
        """Iterate over the messages of the part, as `Recording.messages`."""
        if self.end_s is None:
            return recording.messages(*types, start_s=self.start_s)
        return recording.messages(*types, start_s=self.start_s, end_s=self.end_s)
