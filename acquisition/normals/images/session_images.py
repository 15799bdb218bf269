"""Normalisation of a session's frames within a window, in blocks of rows.

Subtraction of the lamp-off frame of the same exposure time removes ambient light, black level and dark current at once.
"""

import numpy as np

from acquisition import image_values, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.shot import Observations, Shot
from acquisition.normals.images import exposure_merge, normalised_images
from acquisition.normals.images.normalised_images import ImageBlock, Images


def lit_shots(observations: Observations) -> list[tuple[Shot, Light]]:
    """Returns the lit shots, each with its light. Raises RigError normals.infeasible if there are fewer than three, or
    if a position is not finite."""
    shots = observations.lit
    normalised_images.refuse_few(len(shots))
    if not np.all(np.isfinite([light.position for _, light in shots])):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "a light's position is not finite: measure the pose again")
    return shots


def read(
    observations: Observations, calibration: Calibration, rows: slice, columns: slice,
    log_intensity: FloatArray | None = None,
) -> Images:  # fmt: skip
    """Subtracts dark frames, normalises and applies the flat field, for all lit images within a window.

    `log_intensity` (F,) is the log of each lamp's brightness over the calibrated one, if known; images are divided by
    it. Several exposures of one image are merged (`exposure_merge`). The stated sensor noise is that in the image's
    centre; elsewhere the lens changes it by a few per cent. Raises RigError normals.infeasible as `lit_shots` does, and
    if a frame's size is not the calibration's or a lamp-off frame is missing.
    """
    shots, lights = zip(*lit_shots(observations), strict=True)
    sets = [exposure_merge.groups(observations.frames_of(shot)) for shot in shots]
    frames = [shot for groups in sets for group in groups for shot in group]
    _refuse_unusable(frames, observations, calibration)
    darks = {shot.exposure_s: observations.darks[shot.exposure_s] for shot in frames}
    black = calibration.sensor.black_level_dn
    ambient = {seconds: _window_mean(observations, dark, rows, columns) - black for seconds, dark in darks.items()}
    noise = [_noise(groups, calibration, ambient) for groups in sets]
    factors = np.exp(np.zeros(len(shots)) if log_intensity is None else log_intensity)

    def block(start: int, stop: int) -> ImageBlock:
        lines = slice(rows.start + start, rows.start + stop)

        def window(shot: Shot) -> np.ndarray:
            return observations.frames.rows(shot.frame, lines.start, lines.stop)[:, columns]

        dark = {seconds: window(shot) for seconds, shot in darks.items()}
        merged = [
            exposure_merge.merge(groups, window, dark, one, calibration)
            for groups, one in zip(sets, noise, strict=True)
        ]
        values, clipped, extra = np.stack([one.values for one in merged]), [one.clipped for one in merged], None
        sensitivity = image_values.sensitivity(calibration, lines, columns)
        if sensitivity is not None:
            values /= sensitivity
        if log_intensity is not None:
            values /= factors.astype(np.float32)[:, None, None]
        if len(frames) > len(shots):
            extra = np.zeros_like(values)
            for into, one, factor in zip(extra, merged, factors, strict=True):
                if one.extra is not None:
                    into[:] = one.extra / np.float32(factor**2)
        return ImageBlock(values, np.stack(clipped), extra)

    photons, floor = np.array([exposure_merge.all_counting(one) for one in noise]).T
    labels = tuple(f"{number} ({shot.frame.path})" for number, shot in enumerate(shots))
    stored = Images(block, lights, rows, columns, photons / factors, floor / factors**2, labels)
    return normalised_images.held_if_small(stored, merged=len(frames) > len(shots))


def common_lamp_errors(observations: Observations, calibration: Calibration) -> FloatArray | None:
    """Returns `lamp_pose.common_errors` (F, 3, C) of the lit images; none if a tool pose is not on record."""
    poses = [shot.base_from_tool for shot, _ in lit_shots(observations)]
    known = [pose for pose in poses if pose is not None]
    return lamp_pose.common_errors(np.array(known), calibration) if len(known) == len(poses) else None


def _noise(
    groups: list[exposure_merge.FrameGroup], calibration: Calibration, ambient_dn: dict[float, float]
) -> FloatArray:
    """Returns shot noise and floor (2, G) of groups of frames, from the mean signal above black of each exposure time's
    lamp-off frame."""
    times = [FrameExposure(exposure_s=group[0].exposure_s, frames=len(group)) for group in groups]
    return np.array(image_values.frames_noise(calibration, times, [ambient_dn[one.exposure_s] for one in times]))


def _window_mean(observations: Observations, shot: Shot, rows: slice, columns: slice) -> float:
    """Returns the mean over a frame's window."""
    blocks = (
        slice(rows.start + one.start, rows.start + one.stop)
        for one in normalised_images.row_blocks(rows.stop - rows.start)
    )
    parts = (observations.frames.rows(shot.frame, one.start, one.stop)[:, columns] for one in blocks)
    total = sum(float(np.sum(part, dtype=np.float64)) for part in parts)
    return total / ((rows.stop - rows.start) * (columns.stop - columns.start))


def _refuse_unusable(frames: list[Shot], observations: Observations, calibration: Calibration) -> None:
    """Refuses frames without a lamp-off frame, and frames of another size than the calibration's."""
    size = (calibration.width, calibration.height)
    for shot in frames:
        dark = observations.darks.get(shot.exposure_s)
        if dark is None:
            raise RigError(
                ErrorCode.NORMALS_INFEASIBLE,
                f"there is no lamp-off frame for the exposure time {shot.exposure_s:.6g} s of {shot.frame.path}: take "
                "one",
                file=shot.frame.path,
            )
        for frame in (shot.frame, dark.frame):
            if (frame.width, frame.height) != size:
                raise RigError(
                    ErrorCode.NORMALS_INFEASIBLE,
                    f"{frame.path} is {frame.width} × {frame.height} pixels, the calibration is for {size[0]} × "
                    f"{size[1]}: use the images and the calibration of one camera",
                    file=frame.path,
                )
