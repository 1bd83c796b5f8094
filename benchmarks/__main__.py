"""Run one benchmark: `python -m benchmarks NAME`; without a name, list them."""

import importlib
import sys

GROUPS = {
    "accuracy": {
        "real_people": "identity, position and yaw of annotated people, beside other packages",
        "thesis": "the methods of [PIC4SeR] and `best` on its seven scenarios in the lab",
        "ablation": "`best` without each of its parts, with intervals",
        "real_variations": "annotated people in augmented images, other orders and half the rate",
        "lab_people": "`best` on forty random scenes of the lab",
        "trackers": "SORT in the image beside other packages on MOT15",
    },
    "speed": {
        "together": "services in one process and apart, beside the bare network",
        "peers": "the pipeline beside other packages, from image to tracks",
        "own_work": "time of a frame beside the networks, in one thread",
        "tracker_cost": "time of the tracker by number of people",
        "latency": "time of a frame by stage",
        "load": "rate and latency with 1 to 20 people and 1 to 6 cameras",
    },
    "cameras": {
        "cameras": "four cameras in one tracker, and in two areas: hand-overs, faults",
    },
    "motion": {
        "moving_base": "tracks from a driving robot, with its odometry and without",
        "odometry": "odometry correction and dynamic survival on rotating robots",
        "prediction": "predicted positions beside constant velocity, and their calibration",
    },
    "gait": {
        "gait": "points and colours in the lab, beside the figures of [Liu 2018]",
        "gait_bodies": "points and steps of people of a second simulator",
        "gait_real": "steps of real people beside steps counted by hand",
    },
    "faults": {
        "faults": "every service killed and hung: time to recovery, lost frames, identities",
    },
}


def main() -> None:
    """Run the named benchmark with the other arguments, or list all."""
    names = {name for group in GROUPS.values() for name in group}
    if len(sys.argv) < 2 or sys.argv[1] not in names:
        for group, benchmarks in GROUPS.items():
            print(f"{group}:")
            for name, content in benchmarks.items():
                print(f"    {name:16} {content}")
        sys.exit("Usage: python -m benchmarks NAME [--help] [options]")
    name = sys.argv.pop(1)
    sys.argv[0] = f"python -m benchmarks {name}"
    importlib.import_module(f"benchmarks.{name}").main()


if __name__ == "__main__":
    main()
