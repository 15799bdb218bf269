"""Simulated camera on a TCP port: a request is one JSON line, the reply a JSON line and the frame's bytes.

A frame is requested by `{"exposure_s": 0.05, "attempt": 0, "number": 7}`. The answer's line holds width, height, dtype
(always `<u2`), exposure_s, attempt, taken_at (the middle of the exposure, seconds since 1970, UTC) and the number if
one was given. Then width · height · 2 bytes follow, row 0 first. Frames are taken one at a time.

Other requests are answered by a line alone: `{"info": true}`; `{"place": "mirror-sphere"}`, which replaces the object
or target, by `{"placed": label}`; `{"fault": "doubled", "count": 2}`, which disturbs the next frames (`FrameFaults`). A
bad request is answered by `{"error": sentence}` and the connection stays open; a line that is too long closes it.
"""

import json
import math
import socketserver
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from acquisition.models.calibration import Calibration
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import shutter
from hardware_sim.frame_faults import FrameFaults
from hardware_sim.shutter import ExposureInterval, StateSource

LONGEST_REQUEST = 4096
MOST_ATTEMPTS = 100_000

TakeFrame = Callable[[list[ExposureInterval], float, int], npt.NDArray[np.uint16]]
"""Exposure intervals, exposure in s and attempt → frame (H, W)."""

Place = Callable[[str], str]
"""Name of an object or target → its label; raises RigError for an unknown name."""


def no_placing(name: str) -> str:
    """Refuses `name`: this camera's server cannot place objects."""
    raise RigError(ErrorCode.REQUEST_INVALID, f"this camera cannot place objects: {name!r}")


class CameraServer:
    """Serves a camera whose frames come from `take_frame` and whose arm and lamp states come from `source`."""

    def __init__(
        self, camera: SimCameraConfig, calibration: Calibration, take_frame: TakeFrame, source: StateSource,
        place: Place = no_placing,
    ) -> None:  # fmt: skip
        self._camera, self._calibration = camera, calibration
        self._take_frame, self._source = take_frame, source
        self._place = place
        self._turn = threading.Lock()
        self.faults = FrameFaults()
        outer = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                outer.converse(self)

        self._server = _Server((camera.address, camera.port), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="camera", daemon=True)

    def __enter__(self) -> "CameraServer":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def converse(self, connection: socketserver.StreamRequestHandler) -> None:
        """Answers the requests of one connection until its other end closes it."""
        try:
            while line := connection.rfile.readline(LONGEST_REQUEST + 1):
                if self.faults.is_away:
                    return
                if len(line) > LONGEST_REQUEST:
                    connection.wfile.write(_line({"error": f"a request has at most {LONGEST_REQUEST} bytes"}))
                    return
                header, pixels = self._answer(line)
                connection.wfile.write(_line(header))
                if pixels is not None:
                    connection.wfile.write(pixels.astype("<u2", copy=False).tobytes())
        except ConnectionError:
            return  # the client is gone; nothing is left to answer

    def _answer(self, line: bytes) -> tuple[dict[str, Any], npt.NDArray[np.uint16] | None]:
        size = {"width": self._calibration.width, "height": self._calibration.height, "dtype": "<u2"}
        try:
            request = _parse(line)
            if request == {"info": True}:
                pattern = self._calibration.sensor.mosaic
                return {
                    **size,
                    **({} if pattern is None else {"mosaic": pattern}),
                    "bits": self._calibration.sensor.bits,
                    "min_exposure_s": self._camera.min_exposure_s,
                    "max_exposure_s": self._camera.max_exposure_s,
                }, None
            if set(request) == {"place"}:
                return self._placed(request["place"]), None
            if set(request) == {"fault", "count"}:
                self.faults.order(request["fault"], request["count"])
                return {"ordered": request["fault"]}, None
            exposure_s, attempt = self._exposure(request)
        except ValueError as error:
            return {"error": str(error)}, None
        with self._turn:
            begun = time.time()
            try:
                moments = shutter.expose(self._source, exposure_s)
                taken_at = (begun + time.time()) / 2
                frame = self._take_frame(moments, exposure_s, attempt)
            except RigError as error:
                return {"error": error.detail}, None
            header = {**size, "exposure_s": exposure_s, "attempt": attempt, "taken_at": taken_at}
            if "number" in request:
                header["number"] = request["number"]
            return self.faults.applied(header, frame)

    def _placed(self, name: Any) -> dict[str, Any]:
        """Answers a request to place another object or target; it is placed between two frames."""
        if not isinstance(name, str):
            raise ValueError("place must be the name of an object or target")
        with self._turn:
            try:
                return {"placed": self._place(name)}
            except RigError as error:
                return {"error": error.detail}

    def _exposure(self, request: dict[str, Any]) -> tuple[float, int]:
        """Exposure time and attempt of a request. Raises ValueError that states what is wrong."""
        unknown = set(request) - {"exposure_s", "attempt", "number"}
        if unknown:
            raise ValueError(f"unknown fields: {', '.join(sorted(unknown))}")
        exposure_s, attempt = request.get("exposure_s"), request.get("attempt", 0)
        if isinstance(exposure_s, bool) or not isinstance(exposure_s, int | float) or not math.isfinite(exposure_s):
            raise ValueError("exposure_s must be a finite number of seconds")
        low, high = self._camera.min_exposure_s, self._camera.max_exposure_s
        if not low <= exposure_s <= high:
            raise ValueError(f"exposure_s must lie between {low} and {high}")
        if isinstance(attempt, bool) or not isinstance(attempt, int) or not 0 <= attempt <= MOST_ATTEMPTS:
            raise ValueError(f"attempt must be an integer from 0 to {MOST_ATTEMPTS}")
        number = request.get("number", 0)
        if isinstance(number, bool) or not isinstance(number, int):
            raise ValueError("number must be an integer")
        return float(exposure_s), attempt


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False


def _parse(line: bytes) -> dict[str, Any]:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"a request is one line of JSON: {error}") from error
    if not isinstance(request, dict):
        raise ValueError("a request is a JSON object")
    return request


def _line(header: dict[str, Any]) -> bytes:
    return json.dumps(header).encode() + b"\n"
