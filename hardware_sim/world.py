"""Ground truth of the cell: object, table, lamp, camera and room, and how they differ from the calibration.

A `Profile` holds the differences that the solver does not know. Those that belong to one image (lamp intensity, lamp
position, flicker, sensor noise) are sampled from a hash of seed, joints, exposure, lamp and attempt, not from the order
of calls, so that a resumed session sees the same images.

The arm itself neither casts shadows nor hides the object: waypoints keep it clear of both. Where that shall be
simulated, its links join the mesh that `Tracer` is made from, for each set of joints.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from hardware_sim import footprint, object_spec, render, sensor
from hardware_sim.controller import kinematics
from hardware_sim.controller.calibration import calibrated
from hardware_sim.indirect import IndirectLight
from hardware_sim.object_spec import ObjectSpec
from hardware_sim.render import Lamp, Lens
from hardware_sim.tracing import Tracer
from hardware_sim.truth import Truth

ProfileName = Literal["ideal", "direct", "realistic"]


@dataclass(frozen=True)
class Profile:
    """Deviations of the world from its calibration.

    `intensity_sigma` (fraction) and `lamp_position_sigma_m` (per axis) are sampled for each image; `camera_shift_m` and
    `camera_turn_rad` are the lengths of a fixed error of the camera's pose in a direction that the seed chooses;
    `ambient_per_s` is the room's light on a white surface under open sky, in full scales per second.
    """

    noise: bool
    intensity_sigma: float = 0.0
    lamp_position_sigma_m: float = 0.0
    camera_shift_m: float = 0.0
    camera_turn_rad: float = 0.0
    ambient_per_s: float = 0.0
    interreflections: bool = False


PROFILES: dict[str, Profile] = {
    "ideal": Profile(noise=False),
    "direct": Profile(noise=True, intensity_sigma=0.01, lamp_position_sigma_m=0.001),
    "realistic": Profile(
        noise=True,
        intensity_sigma=0.005,
        lamp_position_sigma_m=0.0003,
        camera_shift_m=1e-4,
        camera_turn_rad=float(np.radians(0.02)),
        ambient_per_s=0.4,
        interreflections=True,
    ),
}

FLICKER_HZ = 100.0
FLICKER_DEPTH = 0.3
DRIFT = 0.02
"""The room's lamps flicker with the mains, and its brightness drifts from image to image (1 σ, fraction)."""

CACHED_IMAGES = 1
"""A frame that is captured again while nothing has moved needs no new rendering, only another exposure."""


@dataclass(frozen=True)
class ExposureInterval:
    """A part of an exposure: its `share` of the exposure time, the arm's joints, the lamp's mean level 0–1."""

    share: float
    joints: tuple[float, ...]
    lamp_level: float


class World:
    """One object in one cell, samples by one camera. Raises RigError config.invalid when the object does not fit."""

    def __init__(
        self,
        cell: CellConfig,
        calibration: Calibration,
        spec: ObjectSpec | str,
        seed: int,
        profile: ProfileName,
        arm_calibration: tuple[int | None, float] = (None, 0.0),
    ) -> None:
        """`spec` describes the object; a text names a built-in one. `arm_calibration` (seed, error in m) is the
        controller's: the lamp truly is where the arm as built has it. Raises RigError request.invalid as
        `object_spec.build` does.
        """
        self.calibration = calibration
        self.cell = cell
        keep_out = cell.object.keep_out
        self.scene = object_spec.build(object_spec.as_spec(spec), seed, keep_out)
        self._profile = PROFILES[profile]
        self._seed = seed
        self._object_from_base = geometry.inverse(keep_out.base_from_object.matrix)
        self._arm = calibrated(kinematics.MODELS[cell.arm.model], *arm_calibration)
        self._flange_from_lamp = cell.arm.flange_from_tool.matrix @ np.array(calibration.tool_from_lamp)
        self._tracer = Tracer(self.scene.mesh)
        self.lens = Lens(
            calibration.width,
            calibration.height,
            np.array(calibration.camera_matrix),
            np.array(calibration.distortion),
            self._object_from_base @ self._true_camera(),
        )
        # Small images have large pixels, which need more samples for the same shadow edges.
        subdivision = 2 if calibration.width >= 400 else 4
        self._view = render.trace_view(self.scene, self._tracer, self.lens, subdivision)
        self._indirect = IndirectLight(self.scene, self._tracer, self._view) if self._profile.interreflections else None
        self._cached_lamp_image = lru_cache(CACHED_IMAGES)(self._lamp_image_at)
        self._ambient: Float32Array | None = None
        if self._indirect is not None and self._profile.ambient_per_s > 0:
            self._ambient = self._indirect.ambient()

    def _true_camera(self) -> FloatArray:
        random = _generator(self._seed, "camera")
        base_from_camera = np.array(self.calibration.base_from_camera)
        shift, turn = random.normal(size=(2, 3))
        error = geometry.pose(
            self._profile.camera_shift_m * shift / np.linalg.norm(shift),
            self._profile.camera_turn_rad * turn / np.linalg.norm(turn),
        )
        return base_from_camera @ error

    def base_from_lamp(self, joints: Sequence[float]) -> FloatArray:
        """The lamp's pose (4, 4) at joints (6,) in rad: the controller's TCP plays no part in it."""
        flange = np.eye(4)
        flange[:3] = np.reshape(kinematics.forward(self._arm, joints), (3, 4))
        return flange @ self._flange_from_lamp

    def lamp_image(self, lamp: Lamp) -> Float32Array:
        """Image (H, W) under a lamp (object frame), without ambient light: direct light and interreflections."""
        image = render.direct_image(self._view, self.scene, self._tracer, lamp)
        return image if self._indirect is None else image + self._indirect.interreflections(lamp)

    def frame(self, intervals: Sequence[ExposureInterval], exposure_s: float, attempt: int) -> npt.NDArray[np.uint16]:
        """The camera's frame (H, W) uint16 of an exposure made of intervals, whose shares add up to 1."""
        profile = self._profile
        is_on = any(moment.lamp_level > 0 for moment in intervals)
        joints = [round(joint / 1e-4) for joint in intervals[0].joints]
        random = _generator(self._seed, joints, repr(exposure_s), is_on, attempt)
        intensity = self.calibration.lamp_intensity * (1 + profile.intensity_sigma * random.normal())
        shift = profile.lamp_position_sigma_m * random.normal(size=3)
        ambient = profile.ambient_per_s * exposure_s * _flicker(exposure_s, random)

        signal = np.zeros((self.lens.height, self.lens.width), dtype=np.float32)
        for moment in intervals:
            power = intensity * exposure_s * moment.share * moment.lamp_level
            if power > 0:
                signal += np.float32(power) * self._cached_lamp_image(tuple(moment.joints), tuple(shift))
        if self._ambient is not None:
            signal += np.float32(ambient) * self._ambient
        return sensor.expose(signal, self.calibration.sensor, random if profile.noise else None)

    def _lamp_image_at(self, joints: tuple[float, ...], shift: tuple[float, ...]) -> Float32Array:
        """Image (H, W) under the lamp at power 1, its position at joints (6,) in rad plus `shift` (3,) in m."""
        base_from_lamp = self.base_from_lamp(joints)
        lamp = Lamp(
            geometry.transform(self._object_from_base, base_from_lamp[:3, 3] + shift),
            geometry.rotate(self._object_from_base, base_from_lamp[:3, 2]),
            1.0,
            self.calibration.reference_m,
            self.calibration.lobe_exponent,
        )
        return self.lamp_image(lamp)

    def truth(self) -> Truth:
        """Ground truth at the pixel centres, in the view frame of the nominal camera."""
        samples = self._centre_samples()
        view_from_object = geometry.inverse(
            self._object_from_base @ geometry.base_from_view(np.array(self.calibration.base_from_camera))
        )
        size = (self.lens.height, self.lens.width)
        normals = np.zeros((*size, 3), dtype=np.float32)
        depth, albedo, mask = np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, bool)
        normals.reshape(-1, 3)[samples.pixels] = geometry.rotate(view_from_object, samples.normals)
        depth.ravel()[samples.pixels] = -geometry.transform(view_from_object, samples.points)[:, 2]
        albedo.ravel()[samples.pixels] = samples.albedo
        mask.ravel()[samples.pixels] = True
        one_surface = footprint.one_surface(samples, self.scene, self._tracer, self.lens)
        return Truth(normals, depth, albedo, mask, one_surface)

    def visibility(self, joints: Sequence[float]) -> BoolArray:
        """Where (H, W) the lamp at joints (6,) lights the object's pixel centres directly, without any shadow."""
        samples = self._centre_samples()
        position = geometry.transform(self._object_from_base, self.base_from_lamp(joints)[:3, 3])
        result = np.zeros(self.lens.height * self.lens.width, dtype=bool)
        result[samples.pixels] = render.lit_mask(samples.points, samples.normals, position, self._tracer, self.scene)
        return result.reshape(self.lens.height, self.lens.width)

    def _centre_samples(self) -> render.Samples:
        rows, columns = np.divmod(np.arange(self.lens.height * self.lens.width, dtype=float), self.lens.width)
        return render.object_samples(self.scene, self._tracer, self.lens.eye, self.lens.directions(columns, rows))


def _generator(*key: object) -> np.random.Generator:
    return np.random.default_rng(int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:16], "big"))


def _flicker(exposure_s: float, random: np.random.Generator) -> float:
    """The room's mean light over an exposure that begins at a random phase of the mains, relative to its mean."""
    phase = random.uniform(0, 2 * np.pi)
    swing = 2 * np.pi * FLICKER_HZ * exposure_s
    wave = (np.sin(phase + swing) - np.sin(phase)) / swing
    return float((1 + DRIFT * random.normal()) * (1 + FLICKER_DEPTH * wave))
