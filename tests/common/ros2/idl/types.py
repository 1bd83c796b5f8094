"""Types of ROS 2 from ros2.idl by idlc of Cyclone DDS 0.10.5 (octet: of 11), unchanged."""

# mypy: ignore-errors

from dataclasses import dataclass

from cyclonedds import idl
from cyclonedds.idl import annotations as annotate
from cyclonedds.idl import types


@dataclass
@annotate.final
class Time(idl.IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
@annotate.final
class Duration(idl.IdlStruct, typename="builtin_interfaces.msg.dds_.Duration_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
@annotate.final
class Header(idl.IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
@annotate.final
class ColorRGBA(idl.IdlStruct, typename="std_msgs.msg.dds_.ColorRGBA_"):
    r: types.float32
    g: types.float32
    b: types.float32
    a: types.float32


@dataclass
@annotate.final
class Point(idl.IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
@annotate.final
class Vector3(idl.IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
@annotate.final
class Quaternion(idl.IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: types.float64
    y: types.float64
    z: types.float64
    w: types.float64


@dataclass
@annotate.final
class Pose(idl.IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
@annotate.final
class PoseStamped(idl.IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
@annotate.final
class PoseWithCovariance(idl.IdlStruct, typename="geometry_msgs.msg.dds_.PoseWithCovariance_"):
    pose: Pose
    covariance: types.array[types.float64, 36]


@dataclass
@annotate.final
class Twist(idl.IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
@annotate.final
class TwistWithCovariance(idl.IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovariance_"):
    twist: Twist
    covariance: types.array[types.float64, 36]


@dataclass
@annotate.final
class Transform(idl.IdlStruct, typename="geometry_msgs.msg.dds_.Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
@annotate.final
class TransformStamped(idl.IdlStruct, typename="geometry_msgs.msg.dds_.TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
@annotate.final
class RegionOfInterest(idl.IdlStruct, typename="sensor_msgs.msg.dds_.RegionOfInterest_"):
    x_offset: types.uint32
    y_offset: types.uint32
    height: types.uint32
    width: types.uint32
    do_rectify: bool


@dataclass
@annotate.final
class CameraInfo(idl.IdlStruct, typename="sensor_msgs.msg.dds_.CameraInfo_"):
    header: Header
    height: types.uint32
    width: types.uint32
    distortion_model: str
    d: types.sequence[types.float64]
    k: types.array[types.float64, 9]
    r: types.array[types.float64, 9]
    p: types.array[types.float64, 12]
    binning_x: types.uint32
    binning_y: types.uint32
    roi: RegionOfInterest


@dataclass
@annotate.final
class Image(idl.IdlStruct, typename="sensor_msgs.msg.dds_.Image_"):
    header: Header
    height: types.uint32
    width: types.uint32
    encoding: str
    is_bigendian: types.uint8
    step: types.uint32
    data: types.sequence[types.uint8]


@dataclass
@annotate.final
class CompressedImage(idl.IdlStruct, typename="sensor_msgs.msg.dds_.CompressedImage_"):
    header: Header
    format: str
    data: types.sequence[types.uint8]


@dataclass
@annotate.final
class JointState(idl.IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    header: Header
    name: types.sequence[str]
    position: types.sequence[types.float64]
    velocity: types.sequence[types.float64]
    effort: types.sequence[types.float64]


@dataclass
@annotate.final
class Odometry(idl.IdlStruct, typename="nav_msgs.msg.dds_.Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
@annotate.final
class TFMessage(idl.IdlStruct, typename="tf2_msgs.msg.dds_.TFMessage_"):
    transforms: types.sequence[TransformStamped]


@dataclass
@annotate.final
class Gid(idl.IdlStruct, typename="rmw_dds_common.msg.dds_.Gid_"):
    data: types.array[types.uint8, 16]


@dataclass
@annotate.final
class NodeEntitiesInfo(idl.IdlStruct, typename="rmw_dds_common.msg.dds_.NodeEntitiesInfo_"):
    node_namespace: types.bounded_str[256]
    node_name: types.bounded_str[256]
    reader_gid_seq: types.sequence[Gid]
    writer_gid_seq: types.sequence[Gid]


@dataclass
@annotate.final
class ParticipantEntitiesInfo(
    idl.IdlStruct, typename="rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_"
):
    gid: Gid
    node_entities_info_seq: types.sequence[NodeEntitiesInfo]


@dataclass
@annotate.final
class KeyValue(idl.IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):
    key: str
    value: str


@dataclass
@annotate.final
class DiagnosticStatus(idl.IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):
    level: types.byte
    name: str
    message: str
    hardware_id: str
    values: types.sequence[KeyValue]


@dataclass
@annotate.final
class DiagnosticArray(idl.IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):
    header: Header
    status: types.sequence[DiagnosticStatus]


@dataclass
@annotate.final
class Person(idl.IdlStruct, typename="people_msgs.msg.dds_.Person_"):
    name: str
    position: Point
    velocity: Point
    reliability: types.float64
    tagnames: types.sequence[str]
    tags: types.sequence[str]


@dataclass
@annotate.final
class People(idl.IdlStruct, typename="people_msgs.msg.dds_.People_"):
    header: Header
    people: types.sequence[Person]
