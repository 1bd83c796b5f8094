"""Motion is played before the frame that needs it."""

from dataclasses import dataclass

from common.io.odometry_order import odometry_first
from people4d.messages import Odometry
from tests import builders


@dataclass(frozen=True)
class Frame:
    stamp_ns: int


def ms(value: int) -> int:
    return value * 1_000_000


def odometry(at_ms: int) -> Odometry:
    return builders.odometry(stamp_ns=ms(at_ms))


def order(*items: Odometry | Frame) -> list[str]:
    played = odometry_first(items)
    names = {True: "odometry", False: "shot"}
    return [f"{names[isinstance(m, Odometry)]} {m.stamp_ns // ms(1)}" for m in played]


def test_the_odometry_after_a_frame_comes_before_it() -> None:
    assert order(odometry(0), Frame(ms(10)), odometry(20), odometry(40), Frame(ms(45))) == [
        *("odometry 0", "odometry 20", "shot 10", "odometry 40", "shot 45")
    ]


def test_odometry_of_the_same_time_is_enough() -> None:
    assert order(odometry(0), odometry(10), Frame(ms(10)), odometry(20)) == [
        *("odometry 0", "odometry 10", "shot 10", "odometry 20")
    ]


def test_without_odometry_nothing_is_held() -> None:
    played = odometry_first(iter([Frame(1), Frame(2)]))
    assert next(played) == Frame(1)


def test_when_odometry_ends_frames_go_on_after_half_a_second() -> None:
    # Frames come every 100 ms after the only odometry at 0; up to 400 ms a frame may still get
    # odometry.
    waiting = order(odometry(0), *(Frame(ms(t)) for t in range(100, 800, 100)), odometry(900))
    assert waiting == ["odometry 0", *(f"shot {t}" for t in range(100, 800, 100)), "odometry 900"]
    items: list[Odometry | Frame] = [odometry(0), *(Frame(ms(t)) for t in (100, 400, 500))]
    played = odometry_first(items)
    assert [next(played).stamp_ns // ms(1) for _ in range(2)] == [0, 100]


def test_a_clock_that_goes_back_holds_nothing() -> None:
    assert order(odometry(9000), Frame(ms(9010)), Frame(ms(0)), Frame(ms(33))) == [
        *("odometry 9000", "shot 9010", "shot 0", "shot 33")
    ]
