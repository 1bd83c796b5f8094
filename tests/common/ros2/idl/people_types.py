"""Types of ROS 2 from ros2.idl by idlc of Cyclone DDS 0.10.5, octet as of 11; none made by us."""

# mypy: ignore-errors

from dataclasses import dataclass

from cyclonedds import idl
from cyclonedds.idl import annotations as annotate
from cyclonedds.idl import types

from tests.common.ros2.idl.common_types import (
    AccelWithCovariance,
    ColorRGBA,
    CompressedImage,
    Duration,
    Header,
    Point,
    Pose,
    Pose2D,
    PoseWithCovariance,
    Twist2D,
    TwistWithCovariance,
    Vector3,
)


@dataclass
@annotate.final
class UVCoordinate(idl.IdlStruct, typename="visualization_msgs.msg.dds_.UVCoordinate_"):
    u: types.float32
    v: types.float32


@dataclass
@annotate.final
class MeshFile(idl.IdlStruct, typename="visualization_msgs.msg.dds_.MeshFile_"):
    filename: str
    data: types.sequence[types.uint8]


@dataclass
@annotate.final
class Marker(idl.IdlStruct, typename="visualization_msgs.msg.dds_.Marker_"):
    header: Header
    ns: str
    id: types.int32
    type: types.int32
    action: types.int32
    pose: Pose
    scale: Vector3
    color: ColorRGBA
    lifetime: Duration
    frame_locked: bool
    points: types.sequence[Point]
    colors: types.sequence[ColorRGBA]
    texture_resource: str
    texture: CompressedImage
    uv_coordinates: types.sequence[UVCoordinate]
    text: str
    mesh_resource: str
    mesh_file: MeshFile
    mesh_use_embedded_materials: bool


@dataclass
@annotate.final
class MarkerArray(idl.IdlStruct, typename="visualization_msgs.msg.dds_.MarkerArray_"):
    markers: types.sequence[Marker]


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


@dataclass
@annotate.final
class Pedestrian(idl.IdlStruct, typename="social_nav_msgs.msg.dds_.Pedestrian_"):
    identifier: str
    pose: Pose2D
    velocity: Twist2D


@dataclass
@annotate.final
class PedestrianWithCovariance(
    idl.IdlStruct, typename="social_nav_msgs.msg.dds_.PedestrianWithCovariance_"
):
    pedestrian: Pedestrian
    covariance: types.array[types.float32, 4]


@dataclass
@annotate.final
class PedestriansWithCovariance(
    idl.IdlStruct, typename="social_nav_msgs.msg.dds_.PedestriansWithCovariance_"
):
    header: Header
    pedestrians: types.sequence[PedestrianWithCovariance]


@dataclass
@annotate.final
class TrackedSegment(idl.IdlStruct, typename="cohan_msgs.msg.dds_.TrackedSegment_"):
    type: types.int8
    pose: PoseWithCovariance
    twist: TwistWithCovariance
    accel: AccelWithCovariance


@dataclass
@annotate.final
class TrackedAgent(idl.IdlStruct, typename="cohan_msgs.msg.dds_.TrackedAgent_"):
    track_id: types.uint64
    state: types.int8
    type: types.int8
    name: str
    segments: types.sequence[TrackedSegment]


@dataclass
@annotate.final
class TrackedAgents(idl.IdlStruct, typename="cohan_msgs.msg.dds_.TrackedAgents_"):
    header: Header
    agents: types.sequence[TrackedAgent]


@dataclass
@annotate.final
class TrackedPerson(idl.IdlStruct, typename="spencer_tracking_msgs.msg.dds_.TrackedPerson_"):
    track_id: types.uint64
    is_occluded: bool
    is_matched: bool
    detection_id: types.uint64
    age: Duration
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
@annotate.final
class TrackedPersons(idl.IdlStruct, typename="spencer_tracking_msgs.msg.dds_.TrackedPersons_"):
    header: Header
    tracks: types.sequence[TrackedPerson]
