"""What drawing gives: the records between renderer, depth sensor, truth and outputs."""

from dataclasses import dataclass

from people4d.messages import F32, F64, U8


@dataclass(frozen=True)
class DepthView:
    """Geometry seen by the camera, without any error.

    Args:
        depth_m: HxW along the optical axis, inf where nothing is.
        owners: HxW, 0 = room or nothing, k + 1 = person k.
        right_depth_m: HxW as the right imager of the stereo pair sees it.
    """

    depth_m: F32
    owners: U8
    right_depth_m: F32


@dataclass(frozen=True)
class PersonView:
    """Truth about one person in one frame.

    Args:
        id: Identity in motion capture.
        position_m: 3, torso = mean of both shoulders and both hips, frame: map.
        velocity_mps: 3, derivative of position_m.
        yaw_rad: Of the chest, frame: map.
        path_yaw_rad: Of the way, frame: map.
        keypoints_m: 17x3, COCO order, frame: map.
        keypoints_px: 17x2, projected; NaN behind the camera.
        visible: 17, True: in the image and not hidden by anything.
        box_xyxy_px: 4, of the whole body as if nothing hid it, cut to the image; NaN if outside.
        visible_share: Part of the body's pixels in the image that nothing hides, 0 to 1.
    """

    id: str
    position_m: F64
    velocity_mps: F64
    yaw_rad: float
    path_yaw_rad: float
    keypoints_m: F64
    keypoints_px: F64
    visible: U8
    box_xyxy_px: F64
    visible_share: float
