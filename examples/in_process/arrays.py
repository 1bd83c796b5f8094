"""People in arrays of one's own: python examples/in_process/arrays.py."""

from people4d_robot import Intrinsics, Pipeline, mount
from services.camera.sources import open_source  # the shipped recording in place of a camera

recording = open_source("deploy/demo/crossing.mcap")
frames = [(one.rgb, one.depth_mm, one.stamp_ns / 1e9) for one in recording]
lens = Intrinsics(fx=615.0, fy=615.0, cx=319.5, cy=239.5)

with Pipeline() as pipeline:
    pipeline.add_camera("front", lens, mount(z_m=1.15, rpy_rad=(0.0, 0.052, 0.0)))
    for rgb, depth_mm, stamp_s in frames[:60]:
        people = pipeline.process(rgb, depth_mm, stamp_s)
        for person in people.tracks if people else ():
            print(f"{stamp_s:.2f} s: #{person.id} at {person.position_m.round(2)} m")
