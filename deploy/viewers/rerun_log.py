"""Messages in Rerun: images, people, transforms, latency and predictions."""

from contextlib import suppress
from pathlib import Path
from subprocess import Popen

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from common.drawing.people import ARROW_M
from common.drawing.strokes import Colour, colour_of
from common.io.images import encode_jpeg, encode_png16
from common.runtime.latency import end_to_end, merge_stages, segments
from deploy.viewers.rerun_viewer import PORT, start_viewer
from deploy.viewers.scene import (
    PeopleFrame,
    PeopleScene,
    ScenePerson,
    SkeletonFrame,
    predicted_path,
)
from people4d.errors import SourceError
from people4d.messages import (
    F64,
    CameraInfo,
    CompressedRgbdFrame,
    Health,
    Message,
    Odometry,
    Predictions,
    RgbdFrame,
    Skeletons,
    Tracks,
)

SKELETONS = "map/skeletons"
VIEWS_MAX = 64  # maximum number of cameras with a view: each blueprint costs Rerun two threads
PALE = 90  # opacity of predicted joints and limbs, 0 to 255
JPEG_QUALITY = 80
MILLIMETRES = 1000.0  # number of units of depth images in a metre
FLUSH_S = 3.0  # maximum wait at the end, since Rerun waits for ever for a viewer that ended [s]
SIGMAS = 2.4477  # half axes of a 95 % ellipse of x and y, in standard deviations


class RerunLog:
    """Writes messages into a stream of Rerun, which goes to a viewer or to a file.

    Args:
        stream: Stream with its sink.
        viewer: Process of the viewer, if it was started for this stream.
    """

    def __init__(self, stream: rr.RecordingStream, viewer: "Popen[bytes] | None" = None) -> None:
        self._stream = stream
        self._viewer = viewer
        self._scene = PeopleScene()
        self._cameras: set[str] = set()

    def write(self, message: Message, log_time_ns: int) -> None:
        """Log a message with its time of reception; SourceError if the viewer ended."""
        if self._viewer and self._viewer.poll() is not None:
            hint = "Without a display write a file: people4d view --rerun out.rrd."
            raise SourceError("Rerun's viewer ended", hint)
        self._stream.set_time("stamp", timestamp=np.datetime64(message.stamp_ns, "ns"))
        self._stream.set_time("received", timestamp=np.datetime64(log_time_ns, "ns"))
        people = self._scene.add_message(message)
        if isinstance(message, CameraInfo):
            self._calibrate(message)
        elif isinstance(message, RgbdFrame | CompressedRgbdFrame):
            self._frame(message)
        elif isinstance(message, Odometry):
            self._trace_base(message)
        elif isinstance(message, Predictions):
            self._predict(message)
        elif isinstance(message, Skeletons):
            self._stream.log(SKELETONS, _skeletons(self._scene.skeletons(message)))
        elif isinstance(message, Health):
            text = f"{message.instance}: {message.state} {message.reason}".strip()
            level = rr.TextLogLevel.INFO if message.state == "ready" else rr.TextLogLevel.WARN
            self._stream.log("health", rr.TextLog(text, level=level))
        if people:
            self._people(people)
            self._latency(people.tracks)

    def close(self) -> None:
        """Send waiting messages, and end the stream."""
        with suppress(RuntimeError):  # the viewer has ended
            self._stream.flush(timeout_sec=FLUSH_S)
        self._stream.disconnect()

    def _calibrate(self, info: CameraInfo) -> None:
        pinhole = rr.Pinhole(
            focal_length=[info.fx, info.fy],
            principal_point=[info.cx, info.cy],
            resolution=[info.width, info.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.5,
        )
        self._stream.log(f"map/{info.camera}", pinhole, static=True)
        if info.camera not in self._cameras and len(self._cameras) < VIEWS_MAX:
            self._cameras.add(info.camera)
            self._stream.send_blueprint(blueprint(sorted(self._cameras)))

    def _frame(self, frame: RgbdFrame | CompressedRgbdFrame) -> None:
        if isinstance(frame, RgbdFrame):
            colour, depth = encode_jpeg(frame.rgb, JPEG_QUALITY), encode_png16(frame.depth_mm)
        else:
            colour, depth = frame.rgb_jpeg, frame.depth_png
        path = f"map/{frame.camera}"
        self._stream.log(f"{path}/image", rr.EncodedImage(contents=colour, media_type="image/jpeg"))
        self._stream.log(
            f"{path}/depth", rr.EncodedDepthImage(depth, media_type="image/png", meter=MILLIMETRES)
        )

    def _trace_base(self, odometry: Odometry) -> None:
        position_m = [odometry.x_m, odometry.y_m, 0.0]
        turned = rr.RotationAxisAngle(axis=[0, 0, 1], angle=rr.Angle(rad=odometry.theta_rad))
        self._stream.log(
            f"{odometry.frame_id}/{odometry.child_frame_id}",
            rr.Transform3D(translation=position_m, rotation=turned),
            rr.TransformAxes3D(0.5),
        )

    def _people(self, frame: PeopleFrame) -> None:
        camera = f"map/{frame.tracks.camera}"
        if frame.frame_from_optical is not None:
            matrix = frame.frame_from_optical
            self._stream.log(
                camera, rr.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3])
            )
        if frame.skeletons:
            self._stream.log(SKELETONS, _skeletons(frame.skeletons))
        self._stream.log(f"{camera}/boxes", _boxes(frame.people))
        self._stream.log(f"{camera}/limbs", _limbs_px(frame.people))
        tracks = frame.tracks.tracks
        colours = [colour_of(track.id) for track in tracks]
        centres = [track.position_m for track in tracks]
        headings = [(t.position_m, t.yaw_rad, t.id) for t in tracks if t.yaw_rad is not None]
        shown = {
            "people": rr.Points3D(
                centres,
                radii=[0.1] * len(tracks),
                colors=colours,
                labels=[
                    f"#{t.id} {t.state} {np.linalg.norm(t.velocity_mps):.1f} m/s" for t in tracks
                ],
            ),
            "uncertainty": _ellipses(centres, [t.covariance[:2, :2] for t in tracks], colours),
            "headings": rr.Arrows3D(
                origins=[position_m for position_m, _, _ in headings],
                vectors=[
                    [ARROW_M * np.cos(yaw_rad), ARROW_M * np.sin(yaw_rad), 0]
                    for _, yaw_rad, _ in headings
                ],
                colors=[colour_of(number) for *_, number in headings],
            ),
            "trajectories": rr.LineStrips3D(
                list(frame.trajectories.values()),
                colors=[colour_of(track_id) for track_id in frame.trajectories],
            ),
        }
        for name, archetype in shown.items():
            self._stream.log(f"map/{name}", archetype)

    def _predict(self, message: Predictions) -> None:
        paths = [predicted_path(person) for person in message.people]
        colours = [colour_of(person.id) for person in message.people]
        self._stream.log("map/predictions", rr.LineStrips3D(paths, colors=colours))
        centres = [point for path in paths for point in path]
        covariances = [one for person in message.people for one in person.covariances_m2]
        repeated = [colour for colour in colours for _ in message.horizons_s]
        ellipses = _ellipses(centres, covariances, repeated)
        self._stream.log("map/predictions/ellipses", ellipses)

    def _latency(self, tracks: Tracks) -> None:
        total = end_to_end(tracks.trace)
        if total:
            self._stream.log("latency/end_to_end", rr.Scalars(total.ms))
        for part in merge_stages(segments(tracks.trace)):
            self._stream.log(f"latency/{part.service}/{part.stage}", rr.Scalars(part.ms))


def open_log(robot: str, file: Path | None) -> RerunLog:
    """Open a file, or start Rerun's viewer; SourceError if that is impossible."""
    stream = rr.RecordingStream("people4d", recording_id=None)
    stream.send_property("robot", rr.AnyValues(name=robot))
    viewer = None
    try:
        if file:
            file.parent.mkdir(parents=True, exist_ok=True)
            stream.save(file, default_blueprint=blueprint([]))
        else:
            viewer = start_viewer(PORT)
            url = f"rerun+http://127.0.0.1:{PORT}/proxy"
            stream.connect_grpc(url, default_blueprint=blueprint([]))
    except (OSError, RuntimeError) as error:
        name = str(file) if file else "Rerun's viewer"
        raise SourceError(f"{name} cannot be opened: {error}") from error
    return RerunLog(stream, viewer)


def blueprint(cameras: list[str]) -> rrb.Blueprint:
    """Return the blueprint of the viewer: images, people in 3D, latency, health."""
    images = [rrb.Spatial2DView(origin=f"map/{camera}", name=camera) for camera in cameras]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Tabs(*images) if images else rrb.Spatial2DView(origin="map", name="camera"),
                rrb.TimeSeriesView(origin="latency", name="latency [ms]"),
            ),
            rrb.Vertical(
                rrb.Spatial3DView(origin="map", name="people"),
                rrb.TextLogView(origin="health", name="health"),
                row_shares=[3, 1],
            ),
            column_shares=[2, 3],
        ),
        collapse_panels=True,
    )


def _ellipses(
    centres_m: list[F64], covariances_m2: list[F64], colours: list[Colour]
) -> rr.Ellipsoids3D:
    """Return flat discs around 95 % ellipses of x and y."""
    radii_m = [SIGMAS * np.sqrt(max(np.linalg.eigvalsh(c)[-1], 0.0)) for c in covariances_m2]
    sizes = [[radius_m, radius_m, 0.01] for radius_m in radii_m]
    return rr.Ellipsoids3D(centers=centres_m, half_sizes=sizes, colors=colours)


def _boxes(people: tuple[ScenePerson, ...]) -> rr.Boxes2D:
    detected = [(view, view.detection) for view in people if view.detection]
    return rr.Boxes2D(
        array=np.array([d.box_xyxy_px for _, d in detected], np.float32).reshape(-1, 4),
        array_format=rr.Box2DFormat.XYXY,
        labels=[view.label for view, _ in detected],
        colors=[colour_of(view.id) for view, _ in detected],
    )


def _limbs_px(people: tuple[ScenePerson, ...]) -> rr.LineStrips2D:
    limbs = [(ends, colour_of(view.id)) for view in people for ends in view.limbs_px()]
    return rr.LineStrips2D([ends for ends, _ in limbs], colors=[colour for _, colour in limbs])


def _skeletons(frame: SkeletonFrame) -> rr.LineStrips3D:
    segments_m, colours = [], []
    for skeleton in frame.skeletons:
        for ends_m, measured in skeleton.limbs():
            segments_m.append(ends_m)
            colours.append([*colour_of(skeleton.id), 255 if measured else PALE])
    return rr.LineStrips3D(segments_m, colors=colours)
