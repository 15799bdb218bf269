"""Prometheus metrics, computed from journal and rig status at each scrape, so that a restart loses none."""

import itertools
import math
from collections.abc import Iterator

from fastapi import APIRouter, Request
from fastapi.responses import Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.devices.ur.arm import UrArm
from acquisition.session_state import State
from api.rest import stored_files
from api.rest.camera_preview import CameraPreview
from api.rest.dependencies import ServiceOf
from api.rest.events import EventFeed
from api.rest.wiring import Service

router = APIRouter(tags=["health"])


@router.get(
    "/metrics",
    response_class=Response,
    responses=stored_files.binary("text/plain", description="One line for each metric"),
)
def metrics(service: ServiceOf, request: Request) -> Response:
    """Returns the service's metrics in Prometheus' text format."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_RigCollector(service, request.app.state.feed, request.app.state.camera_preview))
    return Response(generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})


class _RigCollector(Collector):
    def __init__(self, service: Service, feed: EventFeed, preview: CameraPreview) -> None:
        self._service = service
        self._feed = feed
        self._preview = preview

    def collect(self) -> Iterator[Metric]:
        """Yields all metrics at this moment."""
        status, counts = self._service.runner.status(), self._service.store.journal.counts()
        yield InfoMetricFamily("lightpose_cell", "The cell", {"name": status.cell, "arm_model": status.arm_model})
        sessions = GaugeMetricFamily("lightpose_sessions", "Sessions by state", labels=["state"])
        for state in State:
            sessions.add_metric([str(state)], counts.sessions.get(state, 0))
        yield sessions
        yield CounterMetricFamily("lightpose_events", "Events recorded so far", value=counts.events)
        yield GaugeMetricFamily("lightpose_shots", "Images in the data folder's journal", value=counts.shots)
        yield GaugeMetricFamily("lightpose_event_listeners", "Clients that follow events", value=self._feed.listeners)
        yield GaugeMetricFamily(
            "lightpose_preview_viewers", "Clients that watch the camera", value=self._preview.viewers
        )
        spent = CounterMetricFamily(
            "lightpose_compute_processor_seconds", "Processor time of routes, plans, solves, estimates", labels=["job"]
        )
        for job, seconds in sorted(self._service.runner.processor_s.items()):
            spent.add_metric([job], seconds)
        yield spent
        yield GaugeMetricFamily("lightpose_arm_connected", "The arm answers", value=status.reading.connected)
        yield GaugeMetricFamily("lightpose_camera_ready", "The camera answers", value=status.camera_ready)
        yield from self._frames()
        yield GaugeMetricFamily("lightpose_may_start", "A session may start", value=status.may_start)
        yield GaugeMetricFamily(
            "lightpose_safety_latched", "A safety fault waits for a person", value=status.latched is not None
        )
        yield from self._lateness()
        yield GaugeMetricFamily("lightpose_free_bytes", "Free space of the data folder", value=self._service.store.free)

    def _frames(self) -> Iterator[Metric]:
        camera = self._service.rig.camera
        if isinstance(camera, AccountedCamera):
            frames = CounterMetricFamily(
                "lightpose_camera_frames",
                "Frames since the service began: good, retaken, and the faults by kind",
                labels=["outcome"],
            )
            for outcome, count in sorted({"good": 0, "retaken": 0, **camera.counts}.items()):
                frames.add_metric([outcome], count)
            yield frames

    def _lateness(self) -> Iterator[Metric]:
        arm = self._service.rig.arm
        late = sorted(arm.lateness_s) if isinstance(arm, UrArm) else []
        if late:
            quantiles = GaugeMetricFamily(
                "lightpose_lease_lateness_seconds",
                "How late the lease was renewed while the arm moved; a lease older than 0.2 s stops the arm",
                labels=["quantile"],
            )
            for quantile in (0.5, 0.99, 1.0):
                quantiles.add_metric([str(quantile)], late[math.ceil(quantile * len(late)) - 1])
            yield quantiles
            yield GaugeMetricFamily(
                "lightpose_lease_renewals", "Number of renewals in these quantiles", value=len(late)
            )
        if isinstance(arm, UrArm) and any(arm.wakeups.values()):
            counts = itertools.accumulate(arm.wakeups.values())
            buckets = [("+Inf" if math.isinf(s) else str(s), n) for s, n in zip(arm.wakeups, counts, strict=True)]
            yield HistogramMetricFamily(
                "lightpose_driver_lateness_seconds",
                "How late the arm's driver woke for its turns; at 0.25 s the controller's watchdog stops the arm",
                buckets=buckets,
                sum_value=None,
            )
