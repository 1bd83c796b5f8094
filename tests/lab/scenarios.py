"""Small scenarios in files."""

from pathlib import Path

EPOCH_NS = 1_767_225_600 * 10**9  # 2026-01-01 00:00 UTC
FRAMES = 12  # 1.2 s at 10 Hz
SIZE = (60, 80)  # height and width of the images

WALK = """
about = "Two people cross."
duration_s = 1.2
seed = 5

[camera]
width = 80
height = 60
focal_px = 77.0
fps = 10
{camera}

[[people]]
body = "adam"
start = [3.0, -0.6]
face_deg = 90.0
path = [{{ to = [3.0, 0.6] }}]

[[people]]
body = "bea"
start = [3.8, 0.5]
face_deg = -90.0
path = [{{ to = [3.8, -0.5] }}]
"""
DRIVE = "drive = [{ for_s = 1.2, speed_mps = 0.2, turn_dps = 10.0 }]"


def write_scenario(folder: Path, camera: str = "", name: str = "walk") -> Path:
    """Write a scenario; additional lines go into its table of the camera."""
    path = folder / f"{name}.toml"
    path.write_text(WALK.format(camera=camera))
    return path
