"""People before an Intel RealSense: pip install pyrealsense2, then python realsense.py."""

import numpy as np
import pyrealsense2 as rs

from people4d_robot import Pipeline, mount

config, device, align = rs.config(), rs.pipeline(), rs.align(rs.stream.color)
config.enable_stream(rs.stream.color, 640, 480, rs.format.rgb8, 30)
config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
profile = device.start(config)
lens = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
scale_m = profile.get_device().first_depth_sensor().get_depth_scale()

with Pipeline() as pipeline:
    matrix = [[lens.fx, 0, lens.ppx], [0, lens.fy, lens.ppy], [0, 0, 1]]
    pipeline.add_camera("realsense", matrix, mount(z_m=1.2))
    while True:
        frames = align.process(device.wait_for_frames())
        rgb = np.asarray(frames.get_color_frame().get_data())
        depth_m = np.asarray(frames.get_depth_frame().get_data()) * scale_m
        people = pipeline.process(rgb, depth_m, frames.get_timestamp() / 1000)
        print([(person.id, *person.position_m.round(2)) for person in people.tracks])
