"""People before a RealSense: pip install 'people4d-robot[realsense]', then python realsense.py."""

from people4d_robot import Intrinsics, Pipeline, mount
from services.camera.source import SourceFrame, SourceSetup
from services.camera.sources import open_source

with Pipeline() as pipeline:
    for item in open_source("realsense"):  # or orbbec, oak
        if isinstance(item, SourceSetup):
            lens = item.info
            intrinsics = Intrinsics(
                fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, distortion=lens.distortion
            )
            pipeline.add_camera("front", intrinsics, mount(z_m=1.2))
        elif isinstance(item, SourceFrame):
            people = pipeline.process(item.rgb, item.depth_mm, item.stamp_ns / 1e9)
            for person in people.tracks if people else ():
                print(person.id, person.position_m.round(2))
