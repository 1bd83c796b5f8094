"""Planner that slows down for people, in Python without ROS: topics of rmw_zenoh on Zenoh.

pip install eclipse-zenoh rosbags
python planner.py tcp/127.0.0.1:7447 [MESSAGES]
"""

import math
import sys
from pathlib import Path

import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if len(sys.argv) < 2:
    sys.exit(__doc__)

store = get_typestore(Stores.ROS2_JAZZY)
folder = Path(__file__).parents[2] / "common/ros2/definitions/people_msgs"  # or your own copy
for name in ("Person", "People"):
    text = (folder / f"{name}.msg").read_text()
    store.register(get_types_from_msg(text, f"people_msgs/msg/{name}"))

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
left = int(sys.argv[2]) if len(sys.argv) > 2 else -1
with zenoh.open(config) as session:
    # The key is <domain>/<topic>/<type>/<type hash>.
    people_topic = session.declare_subscriber("0/people/people_msgs::msg::dds_::People_/*")
    for sample in people_topic:
        people = store.deserialize_cdr(sample.payload.to_bytes(), "people_msgs/msg/People").people
        for person in people:
            p, v = person.position, person.velocity
            soon_m = math.hypot(p.x + v.x, p.y + v.y)  # from the frame's origin, in a second
            advice = "slow down" if soon_m < 1.2 else "go on"
            print(f"#{person.tags[0]} will be {soon_m:.2f} m away: {advice}", flush=True)
        left -= 1
        if left == 0:
            break
