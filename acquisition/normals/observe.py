"""Frames to values: the images of a session as a planar stack of normalised values within a window.

The lamp-off frame of the same exposure time takes ambient light, black level and dark current out at once. Frames are
read by rows of the window only, so that the object's part of large images is all that is ever held.
"""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.errors import ErrorCode, RigError
from acquisition.measured import Calibration, Observations, Shot
from acquisition.types import BoolArray, Float32Array, FloatArray, Light


@dataclass(frozen=True)
class Stack:
    """Images in a window of the frame, from whatever source: values y and clipped pixels (F, h, w), and what made them.

    `shot` and `floor` (F,) are the sensor's part of the variance of y, shot·y + floor; where nothing is known of the
    sensor they are zero and the rounding, and the rest is found in the residuals.
    """

    values: Float32Array
    clipped: BoolArray
    lights: tuple[Light, ...]
    rows: slice
    columns: slice
    shot: FloatArray
    floor: FloatArray


def lit_shots(observations: Observations) -> list[tuple[Shot, Light]]:
    """The shots that carry a light, with it. Raises RigError normals.infeasible when there are fewer than three."""
    shots = [(shot, shot.light) for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    if len(shots) < 3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there are {len(shots)} lit images and at least three are needed: take more lights",
            lights=len(shots),
        )
    positions = np.array([light.position for _, light in shots])
    if not np.all(np.isfinite(positions)):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "a light's position is not a number: measure the pose again")
    return shots


def read(observations: Observations, calibration: Calibration, rows: slice, columns: slice) -> Stack:
    """Reads all lit images within a window of rows and columns.

    Raises RigError normals.infeasible when a frame's size is not the calibration's or a lamp-off frame is missing.
    """
    shots = lit_shots(observations)
    black = calibration.sensor.black_level_dn
    darks: dict[float, np.ndarray] = {}
    size = (rows.stop - rows.start, columns.stop - columns.start)
    values = np.empty((len(shots), *size), dtype=np.float32)
    clipped = np.empty((len(shots), *size), dtype=np.bool_)
    for index, (shot, _) in enumerate(shots):
        if shot.exposure_s not in darks:
            darks[shot.exposure_s] = _window(_dark(observations, shot), observations, calibration, rows, columns)
        frame = _window(shot, observations, calibration, rows, columns)
        values[index] = photometry.normalised(frame, darks[shot.exposure_s], shot.exposure_s, calibration)
        clipped[index] = photometry.saturated(frame, calibration.sensor)
    ambient_dn = [float(np.mean(darks[shot.exposure_s])) - black for shot, _ in shots]
    photons, floor = photometry.sensor_noise(calibration, [shot.exposure_s for shot, _ in shots], ambient_dn)
    return Stack(values, clipped, tuple(light for _, light in shots), rows, columns, photons, floor)


def _dark(observations: Observations, shot: Shot) -> Shot:
    try:
        return observations.darks[shot.exposure_s]
    except KeyError:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there is no lamp-off frame for the exposure time {shot.exposure_s:.6g} s of {shot.frame.path}: take one",
            file=shot.frame.path,
        ) from None


def _window(
    shot: Shot, observations: Observations, calibration: Calibration, rows: slice, columns: slice
) -> np.ndarray:
    frame = shot.frame
    if (frame.width, frame.height) != (calibration.width, calibration.height):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"{frame.path} is {frame.width} × {frame.height} pixels, the calibration {calibration.width} × "
            f"{calibration.height}: use the images and the calibration of one camera",
            file=frame.path,
        )
    return observations.frames.rows(frame, rows.start, rows.stop)[:, columns]
