"""Messages in the terminal as they come: drawn anew, or a JSON line each."""

import time
from collections.abc import Callable, Iterator
from typing import Annotated, TypeVar

import msgspec
import typer
from rich.console import Console, RenderableType
from rich.live import Live

from people4d.messages import Message

M = TypeVar("M", bound=Message)

REDRAW_S = 0.1

Once = Annotated[bool, typer.Option("--once", help="Show one message and end.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON line for each message.")]
Timeout = Annotated[
    float | None,
    typer.Option("--timeout", help="End after so many seconds without a message."),
]


def follow(
    messages: Iterator[M],
    draw: Callable[[M], RenderableType],
    *,
    once: bool,
    json: bool,
    waiting: str,
) -> bool:
    """Show messages as they come; return whether there was any.

    Args:
        messages: As they come.
        draw: Makes what is shown of a message.
        once: Show one message and end.
        json: Print a line of JSON for each in place of drawing it.
        waiting: What is shown before the first.
    """
    return _print(messages, once) if json else _draw(messages, draw, once, waiting)


def _print(messages: Iterator[M], once: bool) -> bool:
    message = None
    for message in messages:
        typer.echo(msgspec.json.encode(message, enc_hook=lambda array: array.tolist()).decode())
        if once:
            break
    return message is not None


def _draw(
    messages: Iterator[M], draw: Callable[[M], RenderableType], once: bool, waiting: str
) -> bool:
    console = Console()
    message, drawn_s = None, 0.0
    if once:
        message = next(messages, None)
        if message is not None:
            console.print(draw(message))
        return message is not None
    with Live(waiting, console=console, auto_refresh=False) as live:
        for message in messages:
            # A terminal that is slower than the camera must not hold up reading.
            if time.monotonic() - drawn_s > REDRAW_S:
                live.update(draw(message), refresh=True)
                drawn_s = time.monotonic()
        if message is not None:
            live.update(draw(message), refresh=True)
    return message is not None
