"""A planner that keeps clear of where people will be in a second.

Run it on any machine: `python docs/examples/planner.py tcp/192.168.1.7:7447`
"""

import sys
from itertools import islice

import numpy as np

from people4d import subscribe
from people4d.errors import People4dError

AHEAD_S = 1.0
CLEARANCE_M = 1.2


def main() -> None:
    """Print for every frame how close people will come to the robot, at the map's origin."""
    endpoint = sys.argv[1] if len(sys.argv) > 1 else ""
    frames = int(sys.argv[2]) if len(sys.argv) > 2 else None
    for message in islice(subscribe(endpoint), frames):
        for track in message.tracks:
            soon_m = track.position_m + AHEAD_S * track.velocity_mps
            distance_m = float(np.hypot(*soon_m[:2]))
            advice = "slow down" if distance_m < CLEARANCE_M else "go on"
            print(f"#{track.id} will be {distance_m:.2f} m away: {advice}", flush=True)


if __name__ == "__main__":
    try:
        main()
    except People4dError as error:
        sys.exit(str(error))
