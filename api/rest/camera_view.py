"""What the camera sees, as one JPEG or as a stream of them (MJPEG), without ever disturbing a session.

Viewers pull: each takes the newest picture when it has taken in the last one, so a slow viewer drops pictures and costs
the others nothing. A picture is taken when somebody asks and the newest is older than `PERIOD_S`, once for all who ask.
While a session holds the rig the camera is the session's, and the picture is the last frame that it took.
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
from api.rest import preview, problems
from api.rest.wiring import Service

PERIOD_S = 0.2
TRY_AGAIN_S = 1.0
FIRST_EXPOSURE_S, LONGEST_EXPOSURE_S = 0.05, 0.2
BRIGHT = 0.5
"""The exposure time follows the scene: this share of full scale for the 99.5th percentile."""
BOUNDARY = b"picture"


@dataclass(frozen=True)
class Picture:
    """One picture; `source` differs when what it shows does."""

    jpeg: bytes
    source: object


class View:
    """The newest picture of a service's camera; on the event loop."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._taking = asyncio.Lock()
        self._ending = asyncio.Event()
        self._newest: Picture | RigError | None = None
        self._taken_at = 0.0
        self._exposure_s = FIRST_EXPOSURE_S
        self.viewers = 0

    def end(self) -> None:
        """Ends all streams; on the event loop, waits for nothing."""
        self._ending.set()

    async def picture(self) -> Picture:
        """The newest picture, at most `PERIOD_S` old.

        Raises RigError rig.busy where a session has taken none yet, rig.not_ready, camera.unreachable, camera.timeout,
        device.disconnected, store.corrupt.
        """
        async with self._taking:
            if self._newest is None or time.monotonic() > self._taken_at + PERIOD_S:
                try:
                    self._newest = await anyio.to_thread.run_sync(self._take, limiter=self._service.limits.view)
                except RigError as error:
                    self._newest = error
                self._taken_at = time.monotonic()
            if isinstance(self._newest, RigError):
                raise self._newest
            return self._newest

    async def stream(self, first: Picture) -> AsyncGenerator[bytes, None]:
        """Parts of a multipart answer, each as soon as the last one is taken in, until `end`."""
        picture, shown, pause = first, None, PERIOD_S
        self.viewers += 1
        try:
            yield b"--" + BOUNDARY + b"\r\n"
            while not self._ending.is_set():
                if picture.source != shown:
                    yield _part(picture.jpeg)
                    shown = picture.source
                try:
                    await asyncio.wait_for(self._ending.wait(), pause)
                except TimeoutError:
                    pause = PERIOD_S
                else:
                    return
                try:
                    picture = await self.picture()
                except RigError:  # the last picture stays until the camera is back
                    pause = TRY_AGAIN_S
        finally:
            self.viewers -= 1

    def _take(self) -> Picture:
        holder = self._service.store.journal.holder()
        if holder is None:
            return self._look()
        shots = self._service.store.journal.shots(holder.id)
        if not shots:
            raise RigError(
                ErrorCode.RIG_BUSY, f"Session {holder.id} holds the rig and has taken no image yet", holder=holder.id
            )
        path = self._service.store.data / "sessions" / holder.id / shots[-1].frame.path
        return self._stored(path)

    def _stored(self, path: Path) -> Picture:
        if isinstance(self._newest, Picture) and self._newest.source == path:
            return self._newest
        return Picture(preview.jpeg(preview.pixels_of(path), self._service.calibration.sensor), path)

    def _look(self) -> Picture:
        limits, sensor = self._service.cell.camera, self._service.calibration.sensor
        longest = min(limits.max_exposure_s, LONGEST_EXPOSURE_S)
        exposure_s = float(np.clip(self._exposure_s, limits.min_exposure_s, max(longest, limits.min_exposure_s)))
        frame = self._service.runner.preview.take_frame(exposure_s)
        bright = (float(np.percentile(frame.pixels, 99.5)) - sensor.black_level_dn) / sensor.full_scale_dn
        self._exposure_s = exposure_s * float(np.clip(BRIGHT / max(bright, 1e-6), 0.1, 10.0))
        return Picture(preview.jpeg(frame.pixels, sensor), frame.taken_at)


router = APIRouter(tags=["rig"])

_PROBLEMS = problems.declared(
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
    """What the camera sees now; while a session holds the rig, the last frame that it took."""
    view: View = request.app.state.view
    picture = await view.picture()
    return Response(picture.jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-store"})


@router.get(
    "/v1/rig/preview.mjpeg",
    response_class=StreamingResponse,
    responses={
        200: {"description": "An endless stream of JPEGs", "content": {"multipart/x-mixed-replace": {}}},
        **_PROBLEMS,
    },
)
async def preview_stream(request: Request) -> StreamingResponse:
    """What the camera sees, as it changes; a slow viewer is shown fewer pictures."""
    view: View = request.app.state.view
    first = await view.picture()
    return StreamingResponse(
        view.stream(first),
        media_type=f"multipart/x-mixed-replace; boundary={BOUNDARY.decode()}",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


def _part(jpeg: bytes) -> bytes:
    """One picture with the boundary behind it, at which browsers show it."""
    head = b"Content-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg)
    return head + jpeg + b"\r\n--" + BOUNDARY + b"\r\n"
