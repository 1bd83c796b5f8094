"""People in a video with a folder of depth images: opencv_folder.py VIDEO FOLDER."""

import sys
from pathlib import Path

import cv2

from people4d_robot import Intrinsics, Pipeline

video, depths = cv2.VideoCapture(sys.argv[1]), sorted(Path(sys.argv[2]).glob("*.png"))
with Pipeline() as pipeline:
    pipeline.add_camera("front", Intrinsics(fx=615.0, fy=615.0, cx=319.5, cy=239.5))
    for number, file in enumerate(depths):
        found, bgr = video.read()
        if not found:
            break
        rgb, depth_mm = (
            cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB),
            cv2.imread(str(file), cv2.IMREAD_ANYDEPTH),
        )
        people = pipeline.process(rgb, depth_mm, number / video.get(cv2.CAP_PROP_FPS))
        print([(person.id, *person.position_m.round(2)) for person in people.tracks])
