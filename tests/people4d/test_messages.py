"""Messages check their fields on creation and on decoding."""

import re
from typing import Any

import msgspec
import numpy as np
import pytest

from people4d.messages import Mask, Message
from people4d.messages.base import MAX_SEQUENCE, check_name
from tests.contract.examples import BY_NAME, DETECTION, RGB, SPAN, TRACK

BAD_FIELDS: list[tuple[str, dict[str, Any], str]] = [
    ("Truth", {"sequence": -1}, f"sequence: expected 0 to {MAX_SEQUENCE}, got -1"),
    ("Truth", {"sequence": 2**53}, f"expected 0 to {MAX_SEQUENCE}, got {2**53}"),
    ("Truth", {"stamp_ns": 2**63}, f"stamp_ns: expected {-(2**62)} to {2**62}, got {2**63}"),
    ("Truth", {"trace": (SPAN,) * 65}, "trace: expected at most 64 elements, got 65"),
    (
        "Detections",
        {"detections": (DETECTION,) * 513},
        "detections: expected at most 512 elements, got 513",
    ),
    (
        "Truth",
        {"frame_id": "a/b"},
        "frame_id: expected 1 to 64 characters from A-Z a-z 0-9 _ . -, the first neither . nor -, "
        "got 'a/b'",
    ),
    # Escape sequences must not reach the terminal of people4d ps.
    ("Health", {"reason": "all\x1b[2Jwell"}, "reason: expected printable text, got"),
    ("Health", {"counters": {"a\nb": 1}}, "counters: expected printable text"),
    ("CameraInfo", {"fx": float("nan")}, "fx: expected 1 to 100000.0, got nan"),
    ("CameraInfo", {"fy": 0.0}, "fy: expected 1 to 100000.0, got 0.0"),
    ("CameraInfo", {"width": 0}, "width: expected 1 to 16384, got 0"),
    ("CameraInfo", {"distortion_model": "fisheye"}, "expected one of none, plumb_bob, "),
    ("CameraInfo", {"distortion": (0.1,)}, "expected 4 or 5 numbers for plumb_bob, got 1"),
    (
        "RgbdFrame",
        {"depth_mm": np.zeros((3, 2), np.uint16)},
        "rgb, (2, 3), got (3, 2)",
    ),
    ("RgbdFrame", {"rgb": RGB[..., 0]}, "rgb: expected shape HxWx3, got 2x3"),
    (
        "RgbdFrame",
        {"rgb": np.zeros((0, 4, 3), np.uint8), "depth_mm": np.zeros((0, 4), np.uint16)},
        "rgb: expected at least one pixel, got none",
    ),
    ("CompressedRgbdFrame", {"rgb_jpeg": b"GIF89a"}, "expected a JPEG file, got other bytes"),
    ("CompressedRgbdFrame", {"depth_png": b""}, "expected a PNG file, got other bytes"),
    ("StaticTransform", {"matrix": np.eye(3)}, "matrix: expected shape 4x4, got 3x3"),
    # A mirror keeps lengths and angles, but its determinant is -1.
    ("StaticTransform", {"matrix": np.diag([-1.0, 1, 1, 1])}, "expected a rotation and a trans"),
    ("StaticTransform", {"matrix": 2 * np.eye(4)}, "expected a rotation and a translation"),
    ("Odometry", {"twist": np.zeros(2)}, "twist: expected shape 3, got 2"),
    ("Odometry", {"theta_rad": float("inf")}, "theta_rad: expected -100 to 100, got inf"),
    ("Detections", {"height": 0}, "height: expected 1 to 16384, got 0"),
    ("Embeddings", {"detections": (0,)}, "vectors: expected 1, one a detection, got 2"),
    ("Embeddings", {"detections": (0, -1)}, "detections: expected elements >= 0, got -1"),
    ("Tracks", {"camera": ""}, "camera: expected 1 to 64 characters from"),
    ("Health", {"gauges": {"a_hz": float("nan")}}, "gauges: expected a finite number, got nan"),
]


@pytest.mark.parametrize(("name", "fields", "problem"), BAD_FIELDS)
def test_a_bad_field_of_a_message_is_refused_with_expected_and_got(
    name: str, fields: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(problem)):
        msgspec.structs.replace(BY_NAME[name], **fields)


BAD_PARTS: list[tuple[msgspec.Struct, dict[str, Any], str]] = [
    (DETECTION, {"score": 1.01}, "score: expected 0 to 1, got 1.01"),
    (DETECTION, {"score": float("nan")}, "score: expected 0 to 1, got nan"),
    (DETECTION, {"box_xyxy_px": np.zeros(3, np.float32)}, "expected shape 4, got 3"),
    (DETECTION, {"keypoints": np.zeros((17, 2), np.float32)}, "expected shape 17x3, got 17x2"),
    (DETECTION, {"position_m": np.array([0, 0, np.nan])}, "expected finite numbers"),
    (DETECTION, {"position_covariance_m2": np.eye(2)}, "expected shape 3x3, got 2x2"),
    (DETECTION, {"position_covariance_m2": np.full((3, 3), np.inf)}, "expected finite numbers"),
    (DETECTION, {"position_covariance_m2": np.diag([1.0, 1, 0])}, "and positive definite"),
    (DETECTION, {"position_covariance_m2": np.diag([-1.0, -1, 1])}, "and positive definite"),
    (DETECTION, {"position_covariance_m2": 1 - 0.1 * np.eye(3)}, "and positive definite"),
    (DETECTION, {"position_covariance_m2": np.triu(np.ones((3, 3)))}, "expected symmetric"),
    (DETECTION, {"position_m": None}, "position_covariance_m2: expected with the position only"),
    (DETECTION, {"heading": np.array([1.0, 1.0, 0.0])}, "heading: expected unit length, got 1.41"),
    (DETECTION, {"heading": np.array([1.0, 0.0])}, "heading: expected shape 3, got 2"),
    (DETECTION, {"heading": np.full(3, np.nan)}, "expected finite numbers"),
    (
        DETECTION,
        {"heading_sigma_rad": 0.0},
        "a finite number > 0 and <= 100, got 0.0",
    ),
    (TRACK, {"id": 0}, "id: expected >= 1, got 0"),
    (TRACK, {"detection": -1}, "detection: expected >= 0, got -1"),
    (TRACK, {"score": 2.0}, "score: expected 0 to 1, got 2.0"),
    (TRACK, {"yaw_rad": float("nan")}, "yaw_rad: expected -100 to 100, got nan"),
    (TRACK, {"time_since_update_s": float("inf")}, "time_since_update_s: expected a finite"),
    (TRACK, {"covariance": np.eye(3)}, "covariance: expected shape 6x6, got 3x3"),
]


@pytest.mark.parametrize(("part", "fields", "problem"), BAD_PARTS)
def test_a_bad_field_of_a_part_is_refused_with_expected_and_got(
    part: msgspec.Struct, fields: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(problem)):
        msgspec.structs.replace(part, **fields)


def test_a_name_is_one_chunk_of_a_key() -> None:
    check_name("camera", "Front_1.left-b")
    for name in ("", "a" * 65, "a/b", "*", "$*", "@x", "a b", "ä", "a\n"):
        with pytest.raises(ValueError, match="camera: expected 1 to 64"):
            check_name("camera", name)


def test_a_mask_packs_eight_pixels_in_a_byte_highest_bit_first() -> None:
    # Rows 0 1 1 and 1 0 1 in a row: 0 1 1 1 0 1, padded to 0111 0100 = 0x74.
    window = np.array([[0, 255, 1], [1, 0, 1]], np.uint8)
    mask = Mask.from_array(window, x_px=4, y_px=5)
    assert mask.bits == b"\x74"
    assert (mask.x_px, mask.y_px, mask.width, mask.height) == (4, 5, 3, 2)
    np.testing.assert_array_equal(mask.window(), window != 0)


def test_a_mask_must_be_filled_exactly() -> None:
    with pytest.raises(ValueError, match="bits: expected 2 bytes, got 1"):
        Mask(x_px=0, y_px=0, width=3, height=3, bits=b"\x00")
    with pytest.raises(ValueError, match="width: expected 1 to 16384, got 0"):
        Mask(x_px=0, y_px=0, width=0, height=3, bits=b"")


def test_messages_are_frozen() -> None:
    message: Message = BY_NAME["Truth"]
    with pytest.raises(AttributeError):
        message.sequence = 3  # type: ignore[misc]


ABSURD: list[tuple[str, dict[str, Any]]] = [
    ("CameraInfo", {"cx": 1e308}),
    ("CameraInfo", {"fx": 1e-300}),
    ("CameraInfo", {"distortion_model": "plumb_bob", "distortion": (1e10, 0.0, 0.0, 0.0, 0.0)}),
    ("StaticTransform", {"matrix": np.eye(4) + np.eye(4, k=3) * 1e9}),
    ("MovingTransform", {"matrix": np.eye(4) + np.eye(4, k=3) * 1e308}),
    ("Odometry", {"x_m": 1e9}),
    ("Odometry", {"covariance": np.eye(3) * 1e300}),
    ("Truth", {"stamp_ns": 2**63 - 1}),
    ("Truth", {"stamp_ns": -(2**63) + 5}),
]


@pytest.mark.parametrize(("name", "fields"), ABSURD)
def test_absurd_but_finite_values_are_refused_with_the_range(
    name: str, fields: dict[str, Any]
) -> None:
    with pytest.raises(ValueError, match=r"expected .* to .*, got"):
        msgspec.structs.replace(BY_NAME[name], **fields)
