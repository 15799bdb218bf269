"""A folder's solved capture in a session's terms: normal map, shots and calibration, which the planner reads.

Near light has all of it but a calibration, for which `near_light` has defaults. Distant light is the limit of near
light: the camera and the lamps stand so far away (`DISTANCE_M`, two hundred times the object's size) that directions
and irradiance differ over the object by less than a per cent, while depth still casts shadows. A distant solve keeps no
Fisher information; it is made here from the measurements that the solve used.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.result import LIT, FisherInformation, NormalMap
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals import near_light
from acquisition.normals.image_set import Camera, DistantLights, ImageSet, NearLights

OBJECT_SIZE_M = 0.1
"""Size that the longer side of an object of unknown scale counts as; shadows do not depend on it."""

DISTANCE_M = 20.0
"""Distance of camera and lamps that stands for distant light: irradiance varies by 1 % over the object, directions by
0.3°, and single precision still resolves 2 µm of depth."""

DIRECTION_SIGMA_RAD = 0.0025
"""1 σ of a distant light's direction, that of near light's default: 1 mm at 0.4 m."""

EXPOSURE = 0.8
"""Fraction of full scale that the brightest pixels of images from elsewhere count as exposed to."""

INFORMATION_PIXELS = 4000
"""Sample pixels of a distant solve that the planner is informed of, as many as the near solve keeps."""


@dataclass(frozen=True)
class EquivalentSession:
    """What the planner reads of a capture."""

    normal_map: NormalMap
    observations: Observations
    calibration: Calibration

    @property
    def center(self) -> FloatArray:
        """Mean (3,) of the solved surface's points, m, view frame. Raises RigError normals.infeasible without any."""
        rows, columns = np.nonzero(self.normal_map.mask)
        if not len(rows):
            raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no pixel has a normal: check mask and images")
        points = _points(self.normal_map, self.calibration, rows, columns).astype(np.float64)
        return np.asarray(np.mean(points, axis=1))


def of_near(images: ImageSet, normal_map: NormalMap) -> EquivalentSession:
    """Near-light images and the normal map that they were solved to. Raises RigError normals.infeasible without lights'
    positions or camera."""
    if not isinstance(images.lights, NearLights):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "near light needs the lamps' positions, these are directions")
    lights = images.lights
    nothing = EquivalentSession(
        normal_map, Observations(shots=[], darks={}, frames=_NoFrames()), near_light.calibration_of(images)
    )
    # An image of a lamp of intensity i is one of i s with a lamp of intensity 1 per s.
    shots = [
        _shot(images, number, lamp_pose.light_at(lights.positions_m[number], nothing.center), float(seconds))
        for number, seconds in enumerate(lights.intensity)
    ]
    return replace(nothing, observations=replace(nothing.observations, shots=shots))


def of_distant(images: ImageSet, normal_map: NormalMap) -> EquivalentSession:
    """Orthographic images under distant lights, and the normal map that they were solved to, as near light from afar.

    Directions of lights are those from `center`. Raises RigError normals.infeasible where nothing is solved.
    """
    if not isinstance(images.lights, DistantLights) or normal_map.notes.get("depth_unit") != "pixel":
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "distant light without a camera is needed here")
    rows, columns = np.nonzero(normal_map.mask)
    if not len(rows):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no pixel has a normal: check mask and images")
    pitch_m = OBJECT_SIZE_M / max(np.ptp(rows) + 1, np.ptp(columns) + 1)
    focal = DISTANCE_M / pitch_m
    camera = Camera(np.array([[focal, 0, np.mean(columns)], [0, focal, np.mean(rows)], [0, 0, 1.0]]))
    depth = np.where(normal_map.mask, DISTANCE_M + pitch_m * normal_map.depth, 0).astype(np.float32)
    # Albedo has the unit of the images' values over the lights' intensities; the planner's is absolute.
    white = float(np.percentile(normal_map.albedo[normal_map.mask], 99.5))
    units = images.lights.directions / np.linalg.norm(images.lights.directions, axis=1, keepdims=True)
    power = np.mean(images.lights.intensities, axis=1)
    center = np.array([0.0, 0.0, -float(np.mean(depth[rows, columns]))])
    far = replace(
        images,
        lights=NearLights(center + DISTANCE_M * units, EXPOSURE * power / np.mean(power), DISTANCE_M),
        camera=camera,
        rough_depth_m=DISTANCE_M,
    )
    far_map = replace(normal_map, depth=depth, albedo=normal_map.albedo / np.float32(white))
    session = of_near(far, far_map)
    calibration = session.calibration.model_copy(update={"lamp_position_sigma_m": DIRECTION_SIGMA_RAD * DISTANCE_M})
    session = replace(session, calibration=calibration)
    return replace(session, normal_map=replace(far_map, information=_information(session)))


def _information(session: EquivalentSession) -> FisherInformation:
    """Fisher information of (g, z) at sample pixels from the images in which they are lit; none of z, for light from
    afar does not depend on it."""
    normal_map, calibration, shots = session.normal_map, session.calibration, session.observations.shots
    rows, columns = np.nonzero(normal_map.mask)
    chosen = np.sort(np.random.default_rng(0).permutation(len(rows))[:INFORMATION_PIXELS])
    rows, columns = rows[chosen], columns[chosen]
    lamp = photometry.lamps([shot.light for shot in shots if shot.light is not None])
    light = photometry.light_vectors(_points(normal_map, calibration, rows, columns), lamp, calibration)
    normal, albedo = normal_map.normals[rows, columns].T, normal_map.albedo[rows, columns]
    value = np.maximum(albedo * np.einsum("fcp,cp->fp", light, normal), 0).astype(np.float64)
    strength = albedo * np.sqrt(np.einsum("fcp,fcp->fp", light, light)).astype(np.float64)
    noise = photometry.noise(calibration, [shot.exposure_s for shot in shots], DISTANCE_M)
    lit = normal_map.flags[:, rows, columns] & LIT > 0
    row = light * np.where(lit, 1 / np.sqrt(noise.variance(value, strength)), 0)[:, None]
    matrices = np.zeros((len(rows), 4, 4))
    matrices[:, :3, :3] = np.einsum("fap,fbp->pab", row, row)
    return FisherInformation(rows.astype(np.int64), columns.astype(np.int64), matrices)


def _points(normal_map: NormalMap, calibration: Calibration, rows: np.ndarray, columns: np.ndarray) -> Float32Array:
    """Points (3, K) of pixels, m, view frame."""
    everywhere = photometry.rays(calibration, slice(0, calibration.height), slice(0, calibration.width))
    return np.ascontiguousarray(photometry.points(everywhere[:, rows, columns], normal_map.depth[rows, columns]))


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
    """The planner reads no frames, and those of an image set are read by the set."""

    def rows(self, frame: FrameRef, start: int, stop: int) -> np.ndarray:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, f"{frame.path}: read it through its image set")
