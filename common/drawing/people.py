"""An annotated frame: people with their boxes, masks, skeletons and tracks."""

from dataclasses import dataclass

import cv2
import numpy as np

from common.drawing.strokes import GREY, WHITE, Colour, colour_of, put_label, put_path
from common.geometry.transforms import apply, project
from people4d.messages import F32, F64, U8, CameraInfo, Detection, Detections, Mask, Track, Tracks

TINT = 0.38  # fraction of the colour in a mask
CONFIDENCE_MIN = 0.3  # minimum confidence of a drawn keypoint
ARROW_M = 0.5  # length of the heading arrow [m]
NEAREST_M = 0.2  # minimum depth of a drawn point [m]

# COCO: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles; left before right.
LIMBS = (
    *((0, 1), (0, 2), (1, 3), (2, 4), (5, 6), (5, 7), (7, 9), (6, 8), (8, 10)),
    *((5, 11), (6, 12), (11, 12), (11, 13), (13, 15), (12, 14), (14, 16)),
)
# Keypoints drawn as dots: not eyes and ears, since they would cover a small face
DOTTED = np.array([k not in (1, 2, 3, 4) for k in range(17)])


@dataclass(frozen=True, slots=True)
class CameraView:
    """Projection from the frame of the tracks into the image."""

    info: CameraInfo
    optical_from_map: F64  # 4x4, optical frame from the frame of the tracks

    def pixels(self, points_m: F64) -> F64 | None:
        """Return the pixels (Nx2) of points (Nx3), None if one is behind the camera."""
        points = apply(self.optical_from_map, points_m)
        return project(points, self.info) if np.all(points[:, 2] > NEAREST_M) else None

    def range_m(self, point_m: F64) -> float:
        """Return the distance of a point from the camera."""
        return float(np.linalg.norm(apply(self.optical_from_map, point_m)))


def annotate(
    rgb: U8, detections: Detections | None, tracks: Tracks | None, view: CameraView | None
) -> U8:
    """Draw people into a copy of a frame (HxWx3, red first); None is unknown."""
    image = rgb.copy()
    people = detections.detections if detections else ()
    owners = {t.detection: t for t in (tracks.tracks if tracks else ()) if t.detection is not None}
    colours = [colour_of(owners[k].id) if k in owners else GREY for k in range(len(people))]
    for person, colour in zip(people, colours, strict=True):
        _draw_body(image, person, colour)
    for k, (person, colour) in enumerate(zip(people, colours, strict=True)):
        label = _label(owners.get(k), person, view)
        put_label(
            image, label, (person.box_xyxy_px[0], person.box_xyxy_px[1]), _text(image), colour
        )
    for track in tracks.tracks if tracks else ():
        _draw_track(image, track, view)
    return image


def _draw_body(image: U8, person: Detection, colour: Colour) -> None:
    if person.mask is not None:
        _tint(image, person.mask, colour)
    left, top, right, bottom = np.clip(person.box_xyxy_px, -9999, 9999)
    cv2.rectangle(
        image,
        (round(float(left)), round(float(top))),
        (round(float(right)), round(float(bottom))),
        colour,
        _line(image),
    )
    if person.keypoints is not None:
        _draw_skeleton(image, person.keypoints, colour)


def _tint(image: U8, mask: Mask, colour: Colour) -> None:
    rows = slice(mask.y_px, mask.y_px + mask.height)
    window = image[rows, mask.x_px : mask.x_px + mask.width]
    inside = mask.window()[: window.shape[0], : window.shape[1]] > 0
    window[inside] = (window[inside] * (1 - TINT) + np.array(colour) * TINT).astype(np.uint8)


def _draw_skeleton(image: U8, keypoints: F32, colour: Colour) -> None:
    confident = keypoints[:, 2] >= CONFIDENCE_MIN
    points = np.clip(keypoints[:, :2], -9999, 9999)
    for a, b in LIMBS:
        if confident[a] and confident[b]:
            put_path(image, points[[a, b]], colour, _line(image))
    for u, v in np.round(points[confident & DOTTED]).astype(int):
        cv2.circle(image, (int(u), int(v)), _line(image) + 1, WHITE, cv2.FILLED, cv2.LINE_AA)


def _draw_track(image: U8, track: Track, view: CameraView | None) -> None:
    """Draw the heading as an arrow, and a lost track as a ring at the predicted position."""
    here = view.pixels(track.position_m[None]) if view else None
    if view is None or here is None or np.abs(here).max() > 9999:
        return
    colour = colour_of(track.id)
    if track.detection is None:
        u, v = (round(float(x)) for x in here[0])
        cv2.circle(image, (u, v), 4 * _line(image), colour, _line(image), cv2.LINE_AA)
        if track.state == "lost":
            put_label(image, f"#{track.id} lost", (u, v), _text(image), colour)
    if track.yaw_rad is not None:
        tip = track.position_m + ARROW_M * np.array(
            [np.cos(track.yaw_rad), np.sin(track.yaw_rad), 0.0]
        )
        ends = view.pixels(np.stack([track.position_m, tip]))
        # The arrow of a person close to the camera would cross the image.
        if ends is not None and np.linalg.norm(ends[1] - ends[0]) < image.shape[1] / 3:
            _draw_arrow(image, ends, colour)


def _draw_arrow(image: U8, ends: F64, colour: Colour) -> None:
    start, tip = np.clip(ends, -9999, 9999)
    back = (start - tip) / max(float(np.linalg.norm(start - tip)), 1e-6) * 5 * _line(image)
    side = np.array([-back[1], back[0]]) * 0.6
    for stroke, width in ((WHITE, 3 * _line(image)), (colour, _line(image) + 1)):
        for path in ((start, tip), (tip + back + side, tip, tip + back - side)):
            put_path(image, np.stack(path), stroke, width)


def _label(track: Track | None, person: Detection, view: CameraView | None) -> str:
    if track is None:
        return f"{person.score:.2f}"
    texts = [f"#{track.id}"]
    if person.position_m is not None:
        texts.append(f"{np.linalg.norm(person.position_m):.2f} m")
    elif view is not None:
        texts.append(f"{view.range_m(track.position_m):.2f} m")
    return "  ".join([*texts, f"{np.linalg.norm(track.velocity_mps):.1f} m/s"])


def _line(image: U8) -> int:
    """Return the width of lines for the image: 2 pixels at a width of 640."""
    width: int = image.shape[1]
    return max(1, round(width / 320))


def _text(image: U8) -> float:
    """Return the height of text for the image: 13 pixels at a width of 640."""
    width: int = image.shape[1]
    return max(9.0, width / 49)
