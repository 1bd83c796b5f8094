"""Messages of the tracker's results."""

from collections.abc import Sequence

import msgspec

from people4d.messages import Detections, ImageTrack, ImageTracks, Message, Span, Track, Tracks
from services.tracker.cameras.poses import CameraPoseLookup
from services.tracker.config import TrackerConfig
from services.tracker.prediction_schedule import DuePrediction


class TrackerOutput:
    """Makes messages of tracks, in the configured frame and states."""

    def __init__(self, config: TrackerConfig, poses: CameraPoseLookup) -> None:
        self._config, self._poses = config, poses

    def tracks(
        self,
        detections: Detections,
        tracks: Sequence[Track],
        time_ns: int,
        trace: tuple[Span, ...],
    ) -> Tracks:
        """Return the message of tracks, with the stamp of the detections."""
        tracks = self._poses.to_output_frame(tracks, time_ns)
        published = tuple(track for track in tracks if self._is_published(track))
        return Tracks(
            stamp_ns=detections.stamp_ns,
            sequence=detections.sequence,
            trace=trace,
            frame_id=self._config.frame_id,
            tracker=self._config.tracker,
            camera=detections.camera,
            tracks=published,
        )

    def predicted_tracks(self, due: DuePrediction, tracks: Sequence[Track]) -> Tracks:
        """Return the message of predicted tracks."""
        message = self.tracks(due.detections, tracks, due.time_ns, ())
        return msgspec.structs.replace(message, stamp_ns=due.stamp_ns, predicted=True)

    def image_tracks(
        self, detections: Detections, tracks: Tracks, image_tracks: Sequence[ImageTrack] | None
    ) -> list[Message]:
        """Return the message of tracks in the image; empty if image tracking is off."""
        if image_tracks is None:
            return []
        message = ImageTracks(
            stamp_ns=tracks.stamp_ns,
            sequence=tracks.sequence,
            trace=tracks.trace,
            camera=tracks.camera,
            tracker=tracks.tracker,
            width=detections.width,
            height=detections.height,
            tracks=tuple(track for track in image_tracks if self._is_published(track)),
        )
        return [message]

    def _is_published(self, track: Track | ImageTrack) -> bool:
        config = self._config
        published = {"tentative": config.publish_tentative, "lost": config.publish_lost}
        return published.get(track.state, True)
