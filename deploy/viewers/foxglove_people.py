"""People in Foxglove: entities of the 3D panel, annotations of the image panel."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from foxglove import messages as fox

from common.drawing.people import ARROW_M
from deploy.viewers.foxglove_primitives import colour, point3, pose_at, stamp
from deploy.viewers.scene import (
    PeopleFrame,
    ScenePerson,
    SceneSkeleton,
    SkeletonFrame,
    predicted_path,
)
from people4d.messages import F64, Predictions, Track

BODY_M = 1.7  # height of the cylinder of a person [m]
TORSO_M = 1.2  # approximate height of the position above the ground [m]
PALE = 0.35  # opacity of predicted joints and limbs
CLEAR = fox.SceneEntityDeletion(type=fox.SceneEntityDeletionType.All)
Vector = fox.Vector3


def people_update(frame: PeopleFrame) -> fox.SceneUpdate:
    """Return cylinder, uncertainty, heading, label and trajectory of each person."""
    entities = {
        f"track {track.id}": {
            "cylinders": [_body(track), _uncertainty(track)],
            "arrows": list(_heading(track)),
            "lines": list(_trajectory(track, frame)),
            "texts": [_label(track, view)],
        }
        for view in frame.people
        if (track := view.track) is not None
    }
    return _scene(frame.tracks.stamp_ns, frame.tracks.frame_id, entities)


def skeletons_update(frame: SkeletonFrame) -> fox.SceneUpdate:
    """Return the skeletons, with pale predicted joints."""
    entities = {
        f"skeleton {k}": {"lines": list(_limbs(skeleton)), "spheres": list(_joints(skeleton))}
        for k, skeleton in enumerate(frame.skeletons)
    }
    return _scene(frame.stamp_ns, frame.frame_id, entities)


def predictions_update(message: Predictions) -> fox.SceneUpdate:
    """Return the predicted path of each person, with an ellipse of 95 % at each horizon."""
    entities = {}
    for person in message.people:
        path = predicted_path(person)
        points = [point3(p) for p in np.vstack([person.position_m[None], path])]
        entities[f"prediction {person.id}"] = {
            "cylinders": [
                _ellipse(mean_m, covariance_m2, colour(person.id, 0.15))
                for mean_m, covariance_m2 in zip(path, person.covariances_m2, strict=True)
            ],
            "lines": [_line(fox.LinePrimitiveLineType.LineStrip, points, person.id, 0.03)],
        }
    return _scene(message.stamp_ns, message.frame_id, entities)


def _scene(
    stamp_ns: int, frame_id: str, entities: Mapping[str, Mapping[str, Any]]
) -> fox.SceneUpdate:
    """Return a scene of entities by id with their primitives, which replaces all earlier ones."""
    return fox.SceneUpdate(
        deletions=[CLEAR],
        entities=[
            fox.SceneEntity(timestamp=stamp(stamp_ns), frame_id=frame_id, id=name, **primitives)
            for name, primitives in entities.items()
        ],
    )


def annotations(frame: PeopleFrame) -> fox.ImageAnnotations:
    """Return box, label and skeleton of each detection, in pixels."""
    time = stamp(frame.tracks.stamp_ns)
    points: list[fox.PointsAnnotation] = []
    texts: list[fox.TextAnnotation] = []
    for view in frame.people:
        if view.detection is None:
            continue
        left, top, right, bottom = (float(x) for x in view.detection.box_xyxy_px)
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        shapes = [(fox.PointsAnnotationType.LineLoop, corners)]
        if view.detection.keypoints is not None:
            limbs = [(float(u), float(v)) for ends in view.limbs_px() for u, v in ends]
            shapes.append((fox.PointsAnnotationType.LineList, limbs))
        points += [
            fox.PointsAnnotation(
                timestamp=time,
                type=kind,
                points=[fox.Point2(x=u, y=v) for u, v in pixels],
                outline_color=colour(view.id),
                thickness=2.0,
            )
            for kind, pixels in shapes
            if pixels
        ]
        texts.append(
            fox.TextAnnotation(
                timestamp=time,
                position=fox.Point2(x=left, y=top),
                text=view.label,
                font_size=14.0,
                text_color=fox.Color(r=1, g=1, b=1, a=1),
                background_color=colour(view.id, 0.8),
            )
        )
    return fox.ImageAnnotations(timestamp=time, points=points, texts=texts)


def _above(position_m: F64, height_m: float) -> F64:
    raised: F64 = position_m + np.array([0.0, 0.0, height_m])
    return raised


def _cylinder(pose: fox.Pose, size: fox.Vector3, shade: fox.Color) -> fox.CylinderPrimitive:
    return fox.CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=shade)


def _body(track: Track) -> fox.CylinderPrimitive:
    centre_m = _above(track.position_m, BODY_M / 2 - TORSO_M)
    shade = colour(track.id, 0.15 if track.state == "lost" else 0.35)
    return _cylinder(pose_at(centre_m), Vector(x=0.5, y=0.5, z=BODY_M), shade)


def _uncertainty(track: Track) -> fox.CylinderPrimitive:
    feet_m = _above(track.position_m, -TORSO_M)
    return _ellipse(feet_m, track.covariance[:2, :2], colour(track.id, 0.5))


def _ellipse(centre_m: F64, covariance_m2: F64, shade: fox.Color) -> fox.CylinderPrimitive:
    """Return the 95 % ellipse of x and y as a flat cylinder."""
    values, vectors = np.linalg.eigh(covariance_m2)
    minor_m, major_m = (2 * math.sqrt(5.991 * max(float(v), 0.0)) for v in values)
    yaw_rad = math.atan2(vectors[1, 1], vectors[0, 1])
    return _cylinder(pose_at(centre_m, yaw_rad), Vector(x=major_m, y=minor_m, z=0.01), shade)


def _heading(track: Track) -> Iterator[fox.ArrowPrimitive]:
    if track.yaw_rad is not None:
        yield fox.ArrowPrimitive(
            pose=pose_at(track.position_m, track.yaw_rad),
            shaft_length=ARROW_M,
            shaft_diameter=0.04,
            head_length=0.12,
            head_diameter=0.1,
            color=colour(track.id),
        )


def _label(track: Track, view: ScenePerson) -> fox.TextPrimitive:
    head_m = _above(track.position_m, BODY_M - TORSO_M + 0.2)
    return fox.TextPrimitive(
        pose=pose_at(head_m),
        billboard=True,
        font_size=0.15,
        color=colour(track.id),
        text=f"{view.label}  {track.state}",
    )


def _trajectory(track: Track, frame: PeopleFrame) -> Iterator[fox.LinePrimitive]:
    path = frame.trajectories.get(track.id)
    if path is not None and len(path) > 1:
        points = [point3(_above(p, -TORSO_M)) for p in path]
        yield _line(fox.LinePrimitiveLineType.LineStrip, points, track.id, 0.03)


def _limbs(skeleton: SceneSkeleton) -> Iterator[fox.LinePrimitive]:
    limbs = list(skeleton.limbs())
    for opacity, shown in ((1.0, True), (PALE, False)):
        ends = [point3(end) for ends_m, measured in limbs if measured == shown for end in ends_m]
        if ends:
            kind = fox.LinePrimitiveLineType.LineList
            yield _line(kind, ends, skeleton.id, 0.03, opacity)


def _joints(skeleton: SceneSkeleton) -> Iterator[fox.SpherePrimitive]:
    size = Vector(x=0.06, y=0.06, z=0.06)
    for joint_m, measured in zip(skeleton.joints_m, skeleton.measured, strict=True):
        if np.isfinite(joint_m).all():
            shade = colour(skeleton.id, 1.0 if measured else PALE)
            yield fox.SpherePrimitive(pose=pose_at(joint_m), size=size, color=shade)


def _line(
    kind: fox.LinePrimitiveLineType,
    points: list[fox.Point3],
    track_id: int | None,
    width_m: float,
    opacity: float = 1.0,
) -> fox.LinePrimitive:
    return fox.LinePrimitive(
        type=kind,
        pose=pose_at(np.zeros(3)),
        thickness=width_m,
        points=points,
        color=colour(track_id, opacity),
    )
