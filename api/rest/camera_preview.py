"""The camera's live image, as one JPEG or as a stream (MJPEG), without ever disturbing a session.

Each viewer takes the newest image when it has received the last one, so a slow viewer drops images and delays nobody
else. An image is captured, once for all viewers, when one asks and the newest is older than `PERIOD_S`. While a session
holds the rig, the camera belongs to the session, and the image is the last frame that the session captured.
"""

import asyncio
import time
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from itertools import count
from pathlib import Path

import anyio.to_thread
import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import Response, StreamingResponse

from acquisition.calibrate import board_view
from acquisition.calibrate.charuco import View
from acquisition.capture import region
from acquisition.models.base import BoolArray
from acquisition.models.cell_config import BoardConfig
from acquisition.models.errors import ErrorCode, RigError
from api.rest import image_encoding, preview_figures, problems, stored_files
from api.rest.dependencies import CallerOf, ServiceOf
from api.rest.open_streams import OpenStreams
from api.rest.preview_figures import Pixels, PreviewFigures
from api.rest.schemas import as_datetime
from api.rest.wiring import Service

PERIOD_S = 0.2
"""Minimum time between two captures, s."""

RETRY_S = 1.0
"""Time between two attempts while the camera does not answer, s."""

FIRST_EXPOSURE_S, LONGEST_EXPOSURE_S = 0.05, 0.2
TARGET_LEVEL = 0.5
"""Target of the exposure control: 99.5th percentile of the signal, fraction of full scale."""

BOUNDARY = b"picture"
"""Separates the parts of the multipart stream."""


FRAME_HEADER = "X-Frame-Number"
"""Header with the number of the frame shown by a picture."""


@dataclass(frozen=True)
class PreviewImage:
    """One frame and its JPEG; `number` counts the frames of different content."""

    number: int
    pixels: Pixels  # (H, W), linear
    jpeg: bytes
    path: Path | None = None  # of a stored frame of a session
    taken_at: datetime | None = None
    exposure_s: float | None = None


class CameraPreview:
    """The newest image of a service's camera, shared by all viewers; lives on the event loop."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._capturing = asyncio.Lock()
        self._stopping = asyncio.Event()
        self._newest: PreviewImage | RigError | None = None
        self._captured_at = 0.0
        self._exposure_s = FIRST_EXPOSURE_S
        self._numbers = count(1)
        self._figures: PreviewFigures | None = None
        self._board: tuple[PreviewImage, View | None, str] | None = None
        self.viewers = 0

    def end(self) -> None:
        """Ends all streams without waiting. Call it on the event loop."""
        self._stopping.set()

    async def image(self) -> PreviewImage:
        """Returns the newest image, at most `PERIOD_S` old.

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

    async def figures(self) -> PreviewFigures:
        """Returns the figures of the newest image, measured once for all callers. Raises RigError as `image` does."""
        image = await self.image()
        figures = self._figures
        if figures is None or figures.frame != image.number:
            self._figures = figures = await anyio.to_thread.run_sync(
                self._measured, image, limiter=self._service.limits.pictures
            )
        return figures

    async def board(self, board: BoardConfig) -> tuple[PreviewImage, View | None, str]:
        """Returns the newest image, the board's view or None, and why there is none; detected once for all callers.

        Raises RigError as `image` does.
        """
        image = await self.image()
        found = self._board
        if found is None or found[0].number != image.number:
            view, why_not = await anyio.to_thread.run_sync(
                board_view.seen, image.pixels, board, limiter=self._service.limits.pictures
            )
            self._board = found = image, view, why_not
        return found

    async def stream(
        self, first: PreviewImage, is_admitted: Callable[[], bool] = lambda: True
    ) -> AsyncGenerator[bytes, None]:
        """Yields the parts of a multipart response until `end`, or until the caller is no longer admitted."""
        image, sent, pause = first, 0, PERIOD_S
        self.viewers += 1
        try:
            yield b"--" + BOUNDARY + b"\r\n"
            while not self._stopping.is_set() and is_admitted():
                if image.number != sent:
                    yield _part(image)
                    sent = image.number
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
        path = self._service.store.session_path(holder.id) / shots[-1].frame.path
        return self._stored(path)

    def _stored(self, path: Path) -> PreviewImage:
        if isinstance(self._newest, PreviewImage) and self._newest.path == path:
            return self._newest
        pixels = image_encoding.read_frame(path)
        jpeg = image_encoding.jpeg(pixels, self._service.calibration.sensor)
        return PreviewImage(next(self._numbers), pixels, jpeg, path)

    def _live(self) -> PreviewImage:
        limits, sensor = self._service.cell.camera, self._service.calibration.sensor
        longest = min(limits.max_exposure_s, LONGEST_EXPOSURE_S)
        exposure_s = float(np.clip(self._exposure_s, limits.min_exposure_s, max(longest, limits.min_exposure_s)))
        frame = self._service.runner.preview.take_frame(exposure_s)
        bright = (float(np.percentile(frame.pixels, 99.5)) - sensor.black_level_dn) / sensor.full_scale_dn
        self._exposure_s = exposure_s * float(np.clip(TARGET_LEVEL / max(bright, 1e-6), 0.1, 10.0))
        jpeg = image_encoding.jpeg(frame.pixels, sensor)
        taken_at = as_datetime(frame.taken_at)
        return PreviewImage(next(self._numbers), frame.pixels, jpeg, None, taken_at, frame.exposure_s)

    @cached_property
    def _keep_out(self) -> BoolArray:
        return region.keep_out(self._service.cell, self._service.calibration)

    def _measured(self, image: PreviewImage) -> PreviewFigures:
        return preview_figures.measured(
            image.pixels, self._keep_out, self._service.calibration.sensor, frame=image.number,
            taken_at=image.taken_at, exposure_s=image.exposure_s,
        )  # fmt: skip


router = APIRouter(tags=["rig"])

PROBLEMS = problems.responses_of(
    ErrorCode.RIG_BUSY,
    ErrorCode.RIG_NOT_READY,
    ErrorCode.CAMERA_UNREACHABLE,
    ErrorCode.CAMERA_TIMEOUT,
    ErrorCode.DEVICE_DISCONNECTED,
)


@router.get(
    "/v1/rig/preview.jpg",
    response_class=Response,
    responses={**stored_files.binary("image/jpeg", description="The image"), **PROBLEMS},
)
async def preview_picture(request: Request) -> Response:
    """Returns the camera's present image; while a session holds the rig, the last frame that the session captured."""
    preview: CameraPreview = request.app.state.camera_preview
    image = await preview.image()
    return Response(image.jpeg, media_type="image/jpeg", headers=_headers(image))


@router.get("/v1/rig/preview/figures", responses=PROBLEMS)
async def preview_figures_of(request: Request, response: Response) -> PreviewFigures:
    """Returns histogram, clipped shares and focus score of the present image, the frame that `preview.jpg` shows."""
    preview: CameraPreview = request.app.state.camera_preview
    response.headers["Cache-Control"] = "no-store"
    return await preview.figures()


@router.get(
    "/v1/rig/preview/clipping.png",
    response_class=Response,
    responses={**stored_files.binary("image/png", description="The overlay"), **PROBLEMS},
)
async def preview_clipping(request: Request, service: ServiceOf) -> Response:
    """Returns a transparent overlay for the present image: red where saturated, blue where no light is measurable."""
    preview: CameraPreview = request.app.state.camera_preview
    image = await preview.image()
    overlay = await anyio.to_thread.run_sync(
        preview_figures.clipping_overlay, image.pixels, service.calibration.sensor, limiter=service.limits.pictures
    )
    return Response(overlay, media_type="image/png", headers=_headers(image))


@router.get(
    "/v1/rig/preview.mjpeg",
    response_class=StreamingResponse,
    responses={
        **stored_files.binary("multipart/x-mixed-replace", description="An endless stream of JPEGs"),
        **PROBLEMS,
        **problems.responses_of(ErrorCode.REQUEST_TOO_MANY_STREAMS),
    },
)
async def preview_stream(request: Request, caller: CallerOf) -> StreamingResponse:
    """Streams the camera's live image. A slow viewer receives fewer images.

    The stream ends when the key or ticket that opened it is no longer valid.
    """
    preview: CameraPreview = request.app.state.camera_preview
    streams: OpenStreams = request.app.state.streams
    first = await preview.image()
    return streams.response(
        caller,
        preview.stream(first, lambda: streams.is_valid(caller)),
        f"multipart/x-mixed-replace; boundary={BOUNDARY.decode()}",
        {"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


def _headers(image: PreviewImage) -> dict[str, str]:
    return {"Cache-Control": "no-store", FRAME_HEADER: str(image.number)}


def _part(image: PreviewImage) -> bytes:
    """Returns one image as a part of the stream, including the next boundary, at which browsers display the image."""
    facts = FRAME_HEADER.encode(), image.number, len(image.jpeg)
    head = b"Content-Type: image/jpeg\r\n%s: %d\r\nContent-Length: %d\r\n\r\n" % facts
    return head + image.jpeg + b"\r\n--" + BOUNDARY + b"\r\n"
