"""Colours of all drawings, red first."""

Colour = tuple[int, int, int]

PEOPLE: tuple[Colour, ...] = (
    (38, 132, 255),
    (255, 138, 30),
    (26, 166, 96),
    (222, 64, 160),
    (240, 190, 20),
    (20, 184, 200),
    (232, 70, 70),
    (140, 84, 232),
    (140, 186, 40),
    (160, 106, 60),
)
PAPER: Colour = (250, 250, 248)
INK: Colour = (32, 36, 42)
FAINT: Colour = (224, 226, 228)
GREY: Colour = (150, 154, 160)
WHITE: Colour = (255, 255, 255)


def colour_of(track: int) -> Colour:
    """Return the colour of a track, the same in every drawing."""
    return PEOPLE[(track - 1) % len(PEOPLE)]


def ink_on(colour: Colour) -> Colour:
    """Return black or white, the one with more contrast to a colour (ITU-R BT.601 luma)."""
    red, green, blue = colour
    return INK if 0.299 * red + 0.587 * green + 0.114 * blue > 150 else WHITE
