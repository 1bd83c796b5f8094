"""Types of ROS 2: CDR and hashes."""

import numpy as np
import pytest

from common.ros2 import types
from people4d.codec import MAX_BYTES
from people4d.errors import ConfigError, DecodeError

# Hashes of ROS 2 Jazzy.
HASHES = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "geometry_msgs/msg/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
}


@pytest.mark.parametrize("kind", HASHES)
def test_hash_is_that_of_ros(kind: str) -> None:
    assert types.type_hash(kind) == f"RIHS01_{HASHES[kind]}"


def test_fields_left_out_are_zero_and_rotations_none() -> None:
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    message = types.decode(kind, types.encode(kind, {"pose": {"covariance": np.eye(6)}}))
    assert (message.pose.pose.orientation.w, message.header.frame_id) == (1.0, "")
    np.testing.assert_array_equal(message.pose.covariance, np.eye(6).ravel())


def test_unknown_field_is_an_error() -> None:
    with pytest.raises(KeyError, match="text"):
        types.encode("std_msgs/msg/String", {"text": ""})


@pytest.mark.parametrize("cdr", [b"", b"\0\1\0\0", b"\0\1\0\0\5\0\0\0ab", b"x" * (MAX_BYTES + 1)])
def test_bytes_that_are_no_message_are_refused(cdr: bytes) -> None:
    with pytest.raises(DecodeError):
        types.decode("std_msgs/msg/String", cdr)


def test_unknown_type_has_no_hash() -> None:
    with pytest.raises(ConfigError):
        types.type_hash("std_msgs/msg/Strings")
