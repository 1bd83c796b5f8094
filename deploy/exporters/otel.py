"""Latency and health for OpenTelemetry: each frame is a trace, each process a resource."""

from collections.abc import Callable, Iterable

from opentelemetry import trace
from opentelemetry.metrics import CallbackOptions, Observation
from opentelemetry.sdk.metrics import MeterProvider
from opentelemetry.sdk.metrics.export import MetricReader
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import SpanProcessor, TracerProvider

from common.runtime.latency import TraceSegment
from common.runtime.monitor import FramePath
from deploy.exporters.measures import BUCKETS_S, LATENCY_TEXT, MEASURES, STAGE_TEXT, Exporter

MAX_PROCESSES = 256
SYSTEM = "people4d"


class OtelExporter(Exporter):
    """Records spans and metrics by the SDK, with the robot as their namespace."""

    def __init__(self, robot: str, spans: SpanProcessor, metrics: MetricReader) -> None:
        super().__init__()
        self._robot = robot
        self._spans = spans
        self._tracers: dict[str, trace.Tracer] = {}
        self._frames = self._tracer(SYSTEM, SYSTEM, "")
        resource = self._resource(SYSTEM, SYSTEM, "")
        self._meters = MeterProvider([metrics], resource, shutdown_on_exit=False)
        meter = self._meters.get_meter(SYSTEM)
        self._stage, self._latency = (
            meter.create_histogram(name, "s", text, explicit_bucket_boundaries_advisory=BUCKETS_S)
            for name, text in (
                ("people4d.stage.duration", STAGE_TEXT),
                ("people4d.latency", LATENCY_TEXT),
            )
        )
        for name, measure in MEASURES.items():
            create = (
                meter.create_observable_counter
                if measure.kind == "counter"
                else meter.create_observable_gauge
            )
            create(f"people4d.{name}", [self._observe(name)], measure.unit, measure.text)

    def add_frame_path(self, path: FramePath) -> None:
        """Add the path of a frame."""
        tracks, end_to_end = path.tracks, path.end_to_end
        frame = self._frames.start_span(
            "frame",
            start_time=end_to_end.start_ns,
            attributes={
                "people4d.camera": tracks.camera,
                "people4d.sequence": tracks.sequence,
                "people4d.stamp_ns": tracks.stamp_ns,
                "people4d.people": len(tracks.tracks),
                **_clock(end_to_end),
            },
        )
        inside = trace.set_span_in_context(frame)
        for part in (*path.parts, *path.parallel):
            tracer = self._tracer(part.service, part.instance, part.process.partition("@")[2])
            piece = tracer.start_span(
                part.name, inside, start_time=part.start_ns, attributes=_clock(part)
            )
            # A span cannot end before its start; a negative duration is an attribute.
            piece.end(max(part.end_ns, part.start_ns))
        frame.end(max(end_to_end.end_ns, end_to_end.start_ns))
        for part in path.stages:
            labels = {"service": part.service, "instance": part.instance, "stage": part.stage}
            if part.ms >= 0 and self._stage_sets.admits(*labels.values()):
                self._stage.record(part.ms / 1e3, labels)
        if end_to_end.ms >= 0 and self._camera_sets.admits(tracks.camera):
            self._latency.record(end_to_end.ms / 1e3, {"camera": tracks.camera})

    def close(self) -> None:
        """Send the remaining values, and stop."""
        self._spans.shutdown()
        self._meters.shutdown()

    def _observe(self, name: str) -> Callable[[CallbackOptions], Iterable[Observation]]:
        def observe(_: CallbackOptions) -> Iterable[Observation]:
            return [Observation(sample.value, sample.labels) for sample in self.samples(name)]

        return observe

    def _tracer(self, service: str, instance: str, host: str) -> trace.Tracer:
        """Return the tracer of a process; beyond the maximum, processes share one."""
        known = self._tracers.get(instance)
        if known:
            return known
        if len(self._tracers) >= MAX_PROCESSES:
            return self._frames
        resource = self._resource(service, instance, host)
        provider = TracerProvider(resource=resource, shutdown_on_exit=False)
        provider.add_span_processor(self._spans)
        return self._tracers.setdefault(instance, provider.get_tracer(SYSTEM))

    def _resource(self, service: str, instance: str, host: str) -> Resource:
        return Resource(
            {
                "service.name": service,
                "service.namespace": self._robot,
                "service.instance.id": instance,
                **({"host.name": host} if host else {}),
            }
        )


def _clock(part: TraceSegment) -> dict[str, float | bool]:
    """Return the uncertainty of a segment by clocks of different hosts, empty on one host."""
    attributes: dict[str, float | bool] = {}
    if part.error_ns is None:
        attributes["people4d.clocks_compared"] = False
    elif part.error_ns:
        attributes["people4d.clock_error_ms"] = part.error_ns / 1e6
    if part.ms < 0:
        attributes["people4d.duration_ms"] = part.ms
    return attributes
