"""The camera's live image, as one JPEG or as a stream of them (MJPEG), without ever disturbing a session.

Viewers pull: each takes the newest image when it has received the last one, so a slow viewer drops images and delays
nobody else. An image is captured when a viewer asks and the newest is older than `PERIOD_S`, one for all viewers. While
a session holds the rig, the camera belongs to the session, and the image is the last frame that it captured.
"""

import asyncio
import time
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from pathlib import Path

import anyio.to_thread
import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import Response, StreamingResponse

from acquisition.models.errors import ErrorCode, RigError
from api.rest import image_encoding, problems
from api.rest.wiring import Service

PERIOD_S = 0.2
"""Least time between two captures, s."""

RETRY_S = 1.0
"""Time between two attempts while the camera does not answer, s."""

FIRST_EXPOSURE_S, LONGEST_EXPOSURE_S = 0.05, 0.2
TARGET_LEVEL = 0.5
"""Level that the exposure time is controlled to: fraction of full scale of the 99.5th percentile."""

BOUNDARY = b"picture"
"""Separates the parts of the multipart stream."""


@dataclass(frozen=True)
class PreviewImage:
    """One encoded image; `source` (time or file) differs for images of different content."""

    jpeg: bytes
    source: object


class CameraPreview:
    """The newest image of a service's camera, shared by all viewers; lives on the event loop."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._capturing = asyncio.Lock()
        self._stopping = asyncio.Event()
        self._newest: PreviewImage | RigError | None = None
        self._captured_at = 0.0
        self._exposure_s = FIRST_EXPOSURE_S
        self.viewers = 0

    def end(self) -> None:
        """Ends all streams; called on the event loop, does not wait."""
        self._stopping.set()

    async def image(self) -> PreviewImage:
        """The newest image, at most `PERIOD_S` old.

        Raises RigError rig.busy when a session holds the rig and has captured none yet, rig.not_ready,
        camera.unreachable, camera.timeout, device.disconnected, store.corrupt.
        """
        async with self._capturing:
            if self._newest is None or time.monotonic() > self._captured_at + PERIOD_S:
                try:
                    self._newest = await anyio.to_thread.run_sync(self._capture, limiter=self._service.limits.view)
                except RigError as error:
                    self._newest = error
                self._captured_at = time.monotonic()
            if isinstance(self._newest, RigError):
                raise self._newest
            return self._newest

    async def stream(self, first: PreviewImage) -> AsyncGenerator[bytes, None]:
        """Yields the parts of a multipart response, each as soon as the last one is sent, until `end`."""
        image, sent_source, pause = first, None, PERIOD_S
        self.viewers += 1
        try:
            yield b"--" + BOUNDARY + b"\r\n"
            while not self._stopping.is_set():
                if image.source != sent_source:
                    yield _part(image.jpeg)
                    sent_source = image.source
                try:
                    await asyncio.wait_for(self._stopping.wait(), pause)
                except TimeoutError:
                    pause = PERIOD_S
                else:
                    return
                try:
                    image = await self.image()
                except RigError:  # the last image stays until the camera answers again
                    pause = RETRY_S
        finally:
            self.viewers -= 1

    def _capture(self) -> PreviewImage:
        holder = self._service.store.journal.holder()
        if holder is None:
            return self._live()
        shots = self._service.store.journal.shots(holder.id)
        if not shots:
            raise RigError(
                ErrorCode.RIG_BUSY, f"Session {holder.id} holds the rig and has captured no image yet", holder=holder.id
            )
        path = self._service.store.data / "sessions" / holder.id / shots[-1].frame.path
        return self._stored(path)

    def _stored(self, path: Path) -> PreviewImage:
        if isinstance(self._newest, PreviewImage) and self._newest.source == path:
            return self._newest
        return PreviewImage(
            image_encoding.jpeg(image_encoding.read_frame(path), self._service.calibration.sensor), path
        )

    def _live(self) -> PreviewImage:
        limits, sensor = self._service.cell.camera, self._service.calibration.sensor
        longest = min(limits.max_exposure_s, LONGEST_EXPOSURE_S)
        exposure_s = float(np.clip(self._exposure_s, limits.min_exposure_s, max(longest, limits.min_exposure_s)))
        frame = self._service.runner.preview.take_frame(exposure_s)
        bright = (float(np.percentile(frame.pixels, 99.5)) - sensor.black_level_dn) / sensor.full_scale_dn
        self._exposure_s = exposure_s * float(np.clip(TARGET_LEVEL / max(bright, 1e-6), 0.1, 10.0))
        return PreviewImage(image_encoding.jpeg(frame.pixels, sensor), frame.taken_at)


router = APIRouter(tags=["rig"])

_PROBLEMS = problems.responses_of(
    ErrorCode.RIG_BUSY,
    ErrorCode.RIG_NOT_READY,
    ErrorCode.CAMERA_UNREACHABLE,
    ErrorCode.CAMERA_TIMEOUT,
    ErrorCode.DEVICE_DISCONNECTED,
)


@router.get(
    "/v1/rig/preview.jpg", response_class=Response, responses={200: {"content": {"image/jpeg": {}}}, **_PROBLEMS}
)
async def preview_picture(request: Request) -> Response:
    """The camera's present image; while a session holds the rig, the last frame that it captured."""
    preview: CameraPreview = request.app.state.camera_preview
    image = await preview.image()
    return Response(image.jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-store"})


@router.get(
    "/v1/rig/preview.mjpeg",
    response_class=StreamingResponse,
    responses={
        200: {"description": "An endless stream of JPEGs", "content": {"multipart/x-mixed-replace": {}}},
        **_PROBLEMS,
    },
)
async def preview_stream(request: Request) -> StreamingResponse:
    """The camera's live image as a stream; a slow viewer receives fewer images."""
    preview: CameraPreview = request.app.state.camera_preview
    first = await preview.image()
    return StreamingResponse(
        preview.stream(first),
        media_type=f"multipart/x-mixed-replace; boundary={BOUNDARY.decode()}",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


def _part(jpeg: bytes) -> bytes:
    """One image as a part of the stream, with the next boundary, at which browsers display it."""
    head = b"Content-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg)
    return head + jpeg + b"\r\n--" + BOUNDARY + b"\r\n"
