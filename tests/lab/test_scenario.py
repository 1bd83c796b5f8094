import math
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest

from common.geometry.transforms import wrap
from lab.bodies.cast import load_cast
from lab.catalogue import FOLDER, load_scenario, scenario_names, split_seed
from lab.scenario import WALKABLE_M
from people4d.errors import ConfigError
from tests.lab.worlds import watch, world

HEAD = 'about = "x"\nduration_s = 3.0\n'
PERSON = '[[people]]\nbody = "adam"\nstart = [3.0, 0.0]\n'

THESIS = {  # people in it; rising in occlusion
    "two_easy": 2,
    "two_crossing": 2,
    "three_easy": 3,
    "three_crossing": 3,
    "three_dense": 3,
    "four_crossing": 4,
    "four_dense": 4,
}

# Table 1 of [Park 2021]: fps, frames, boxes, mean turn in degrees a frame.
ODOMETRY = {
    "pmrr": (15, 266, 899, 3.076),
    "psrm": (15, 366, 1169, 2.420),
    "pmrm1": (15, 460, 1442, 2.369),
    "pmrm2": (20, 449, 1461, 2.091),
    "port1": (20, 739, 2698, 0.858),
    "port2": (20, 564, 1712, 1.034),
}


def refusal(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_scenario(str(path))
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (PERSON + "speedy = 1.0", "people[0]: object contains unknown field `speedy`"),
        ('[[people]]\nbody = "zoe"\nstart = [3.0, 0.0]', "expected one of adam, bea,"),
        ('[[people]]\nbody = "adam"\nstart = [nan, 0.0]', "people[0].start: expected a finite"),
        ('[[people]]\nbody = "adam"\nstart = [inf, 0.0]', "people[0].start: expected a finite"),
        (PERSON + "speed_mps = 3.0", "people[0].speed_mps: expected `float` <= 1.4, got 3.0"),
        (
            PERSON + "path = [{ to = [3, 1], speed_mps = 0.1 }]",
            "path[0].speed_mps: expected `float` >= 0.4",
        ),
        (
            PERSON + "path = [{ to = [3, 1], stop_s = -1.0 }]",
            "path[0].stop_s: expected `float` >= 0",
        ),
        (
            PERSON + "path = [{ to = [3, 9] }]",
            "y -1.45 to 1.45, where the lab is free, got [3.0, 9",
        ),
        (PERSON + PERSON, "people[1]: expected to start at least 0.5 m from people[0]"),
        ('people = []\nroom = "attic"', "room: invalid enum value 'attic'"),
        (
            '[[people]]\nbody = "kim"\nstart = [3.0, 0.0]\nwheelchair = true',
            "wheelchair: expected an adult without acts and stools",
        ),
        (
            PERSON + "wheelchair = true\npath = [{ to = [3, 1], sit = true }]",
            "wheelchair: expected an adult without acts and stools",
        ),
        ("people = []\nseed = -1", "seed: expected `int` >= 0, got -1"),
        ("people = []\n[camera]\nfps = 0.0", "camera.fps: expected `float` >= 1.0, got 0.0"),
        ("people = []\n[camera]\nyaw_deg = nan", "camera.yaw_deg: expected a finite number"),
        ('people = []\n[camera]\nname = "a/b"', "name: expected 1 to 64 characters from"),
        (
            "people = []\n[[camera.drive]]\nfor_s = 0.0",
            "camera.drive[0].for_s: expected `float` >= 0.05",
        ),
        ("people = []\n[capture]\nnoise_m = -1.0", "noise_m: expected `float` >= 0"),
        ("people = [", "invalid value"),
        ("", "missing required field `people`"),
    ],
)
def test_error_in_scenario_names_file_and_field(tmp_path: Path, text: str, error: str) -> None:
    message = refusal(tmp_path, HEAD + text)
    assert error in message
    assert message.startswith(f"scenario {tmp_path / 'mine.toml'}: ")
    assert str(FOLDER) in message  # folder of examples


def test_unknown_scenario_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"unknown scenario nowhere\. There are .*crossing"):
        load_scenario("nowhere")


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load_scenario(str(tmp_path))


def test_scenario_file_of_the_user_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + PERSON)
    scenario = load_scenario(str(path))
    assert scenario.name == "mine"
    assert scenario.people[0].body == "adam"


def test_a_seed_may_follow_the_name() -> None:
    assert split_seed("crossing@7") == ("crossing", 7)
    assert split_seed("crossing") == ("crossing", None)
    with pytest.raises(ConfigError, match="expected a whole number after @, got 'x'"):
        split_seed("crossing@x")


@pytest.mark.parametrize("name", scenario_names())
def test_scenario_files_have_a_description(name: str) -> None:
    assert (FOLDER / f"{name}.toml").read_text().startswith("# ")
    assert load_scenario(name).about.endswith(".")


def test_twins_have_the_same_clothes() -> None:
    cast = load_cast()
    one, other = (cast[person.body] for person in load_scenario("twins").people)
    assert (one.shirt, one.legs, one.shoes) == (other.shirt, other.legs, other.shoes)
    assert one.figure != other.figure


@pytest.mark.parametrize("name", THESIS)
def test_thesis_scenarios_are_a_minute_in_its_room(name: str) -> None:
    scenario = load_scenario(name)
    assert len(scenario.people) == THESIS[name]
    assert (scenario.duration_s, scenario.camera.fps, scenario.room) == (60.0, 30.0, "lab")
    assert (scenario.camera.width, scenario.camera.height) == (640, 480)
    assert not scenario.camera.drive


@pytest.mark.slow
@pytest.mark.parametrize("name", THESIS)
def test_people_of_thesis_scenarios_leave_the_view_and_return(name: str) -> None:
    in_view = watch(world(name), 0.2).in_view
    steps = np.diff(in_view.astype(int), axis=0)
    assert np.count_nonzero(steps < 0) >= 3
    assert np.count_nonzero(steps > 0) >= 3
    assert in_view.mean() > 0.75  # but the person is there most of the time


@pytest.mark.slow
def test_thesis_scenarios_rise_in_occlusion() -> None:
    watches = [watch(world(name), 0.2) for name in THESIS]
    shares = [watched.hidden[watched.in_view].mean() for watched in watches]
    assert shares[0] < 0.01
    assert all(more > less + 0.01 for less, more in pairwise(shares)), shares
    assert 0.2 < shares[-1] < 0.4


@pytest.mark.slow
@pytest.mark.parametrize("name", ODOMETRY)
def test_odometry_scenarios_have_the_frames_and_turns_of_the_table(name: str) -> None:
    fps, frames, _, turn_deg = ODOMETRY[name]
    path = world(name).path
    assert world(name).scenario.camera.fps == fps
    assert world(name).frame_count == frames
    assert (world(name).info.width, world(name).info.height) == (640, 480)
    yaws = [path.pose(world(name).frame_s(index))[2] for index in range(frames)]
    turns = [abs(math.degrees(wrap(after - before))) for before, after in pairwise(yaws)]
    assert np.mean(turns) == pytest.approx(turn_deg, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", ODOMETRY)
def test_odometry_scenarios_show_as_many_people_as_the_table(name: str) -> None:
    _, frames, boxes, _ = ODOMETRY[name]
    in_view = watch(world(name), 0.2).in_view
    assert in_view.sum() / len(in_view) == pytest.approx(boxes / frames, rel=0.1)


@pytest.mark.slow
def test_odometry_scenarios_move_according_to_their_names() -> None:
    for name in ODOMETRY:
        of = world(name)
        routes = [motion.path(np.arange(0, 15, 0.5))[:, :2] for motion in of.motions]
        walked_m = min(np.linalg.norm(np.diff(route, axis=0), axis=1).sum() for route in routes)
        driven_m = max(abs(of.path.twist(t)[0]) for t in np.arange(0.5, 15, 0.5))
        assert (walked_m < 0.1) if name == "psrm" else (walked_m > 1)  # person still or moving
        assert (driven_m > 0.2) if "rm" in name else (driven_m == 0)  # robot moving or turning


@pytest.mark.slow
@pytest.mark.parametrize("name", scenario_names())
def test_people_avoid_walls_and_each_other(name: str) -> None:
    of = world(name)
    times = np.arange(0, of.scenario.duration_s, 0.05)
    routes = [motion.path(times)[:, :2] for motion in of.motions]
    low, high = WALKABLE_M[of.scenario.room]
    for route in routes:
        assert np.all((route > np.array(low) - 0.1) & (route < np.array(high) + 0.1))
    for one, other in combinations(routes, 2):
        assert np.linalg.norm(one - other, axis=1).min() > 0.5
    camera = np.array([of.path.position(t) for t in times.tolist()])
    for route in routes if of.scenario.camera.avoided else ():
        assert np.linalg.norm(route - camera, axis=1).min() > 1.0
