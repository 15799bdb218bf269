"""A solved folder as a session that the planner can read: normal map, shots and calibration.

A folder of near light lacks only a calibration, for which `near_light` has defaults. Distant light is converted to near
light first (`distant.from_afar`).
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.result import NormalMap
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals import near_light
from acquisition.normals.images.image_set import ImageSet

EXPOSURE = 0.8
"""Assumed level of the brightest pixels of a folder's images, as a fraction of full scale."""


@dataclass(frozen=True)
class EquivalentSession:
    """The parts of a session that the planner reads."""

    normal_map: NormalMap
    observations: Observations
    calibration: Calibration

    @property
    def center(self) -> FloatArray:
        """Mean (3,) of the solved points, m, view frame. Raises RigError normals.infeasible if there are none."""
        mask, known = self.normal_map.mask, self.calibration
        if not np.any(mask):
            raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no pixel has a normal: check mask and images")
        ray = photometry.rays(known, slice(0, known.height), slice(0, known.width))[:, mask]
        points = photometry.points(ray, self.normal_map.depth[mask])
        return np.asarray(np.mean(points, axis=1, dtype=np.float64))


def of_near(images: ImageSet, normal_map: NormalMap) -> EquivalentSession:
    """Builds the session of near-light images and the normal map solved from them. Raises RigError normals.infeasible
    if the lights' positions or the camera are missing."""
    lights = near_light.lights_of(images)
    calibration, level = near_light.calibration_of(images), images.exposed_level
    sensor = calibration.sensor  # its full scale is where images are expected to saturate
    gain, full_well = level * sensor.gain_e_per_dn, level * sensor.full_well_e
    sensor = sensor.model_copy(update={"gain_e_per_dn": gain, "full_well_e": full_well})
    calibration = calibration.model_copy(update={"sensor": sensor})
    nothing = EquivalentSession(normal_map, Observations(shots=[], darks={}, frames=_NoFrames()), calibration)
    # A lamp of intensity i is equivalent to an exposure of i seconds with a lamp of intensity 1 per second.
    shots = [
        _shot(images, number, lamp_pose.light_at(lights.positions_m[number], nothing.center), float(seconds))
        for number, seconds in enumerate(lights.intensity / level)
    ]
    return replace(nothing, observations=replace(nothing.observations, shots=shots))


def _shot(images: ImageSet, number: int, light: Light, exposure_s: float) -> Shot:
    return Shot(
        key=ShotKey(pass_number=0, number=number),
        kind="light",
        frame=FrameRef(path=images.names[number], width=images.width, height=images.height, sha256=""),
        exposure_s=exposure_s,
        light=light,
        taken_at=0.0,
        quality=FrameQuality(saturated=0.0, bright_level=EXPOSURE, accepted=True),
    )


class _NoFrames:
    """Refuses to read frames: the planner reads none, and those of an image set are read through the set."""

    def rows(self, frame: FrameRef, start: int, stop: int) -> np.ndarray:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, f"{frame.path}: read it through its image set")
