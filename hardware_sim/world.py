"""Ground truth of the cell: object, table, lamp, camera and room, and how they differ from the calibration.

A `Profile` holds the deviations that the solver does not know. Those of a single image (lamp intensity, lamp position,
flicker, sensor noise) are sampled from a hash of seed, joints, exposure, lamp and attempt. They do not depend on the
order of calls, so a resumed session sees the same images.

A calibration target (`targets`) may take the place of the object. The cell may also differ from its calibration by far
more than a profile states (`true_cell.perturbed`), like a cell that has never been calibrated.

The arm neither casts shadows nor hides the object here, because waypoints keep it clear of the rays from the lamp and
to the lens. To simulate either, add the arm's links to the mesh of `Tracer` for each set of joints.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from hardware_sim import footprint, object_spec, render, sensor, spectra, true_cell
from hardware_sim.controller import kinematics
from hardware_sim.controller.calibration import calibrated
from hardware_sim.indirect import IndirectLight
from hardware_sim.object_spec import ObjectSpec
from hardware_sim.render import Lamp, Lens
from hardware_sim.target_stage import TargetStage
from hardware_sim.tracing import Tracer
from hardware_sim.truth import Truth

ProfileName = Literal["ideal", "direct", "realistic"]


@dataclass(frozen=True)
class Profile:
    """Deviations of the world from its calibration.

    `intensity_sigma` (fraction) and `lamp_position_sigma_m` (per axis) are the standard deviations of errors that are
    sampled once for each image and shared by its frames. `camera_shift_m` and `camera_turn_rad` are the magnitudes of a
    fixed error of the camera's pose, whose direction the seed determines. `ambient_per_s` is the room's light on a
    white surface under open sky, in full scales per second.
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
"""Flicker of the room's light with the mains (Hz, relative amplitude); 1 σ of its drift between images (fraction)."""

FRAMES_APART = 100
"""Attempts that differ by multiples of this number are frames of one light. The arm does not move between them, so they
share the lamp's errors, and a mean over frames does not reduce these. Noise and room light differ between frames."""

CACHED_IMAGES = 1
"""Number of lamp images kept: a frame taken again while nothing has moved needs only a new exposure, no rendering."""


@dataclass(frozen=True)
class ExposureInterval:
    """Part of an exposure: its `share` of the exposure time, the arm's joints and the lamp's mean level, 0–1."""

    share: float
    joints: tuple[float, ...]
    lamp_level: float


class World:
    """One object in one cell, seen by one camera. Raises RigError config.invalid if the object does not fit."""

    def __init__(
        self,
        cell: CellConfig,
        calibration: Calibration,
        spec: ObjectSpec | str,
        seed: int,
        profile: ProfileName,
        arm_calibration: tuple[int | None, float] = (None, 0.0),
        *,
        perturbed: bool = False,
    ) -> None:
        """`spec` describes the object or target, or is the name of a built-in one. `arm_calibration` (seed, error in m)
        is the controller's: the lamp's true pose follows from the arm as built. A `perturbed` cell is one that was
        never calibrated. Raises RigError request.invalid as `object_spec.build` does.
        """
        self.calibration = calibration
        self.cell = cell
        keep_out = cell.object.keep_out
        spec = object_spec.as_spec(spec)
        self.scene = object_spec.build(spec, seed, cell)
        self._profile = PROFILES[profile]
        self._seed = seed
        self._true = true_cell.perturbed(calibration, seed) if perturbed else true_cell.nominal(calibration)
        self._sensitivity = self._true.sensitivity(calibration.width, calibration.height) if perturbed else None
        self._channels = _white_of_sites(calibration)
        self._object_from_base = geometry.inverse(keep_out.base_from_object.matrix)
        self._arm = calibrated(kinematics.MODELS[cell.arm.model], *arm_calibration)
        self._flange_from_lamp = cell.arm.flange_from_tool.matrix @ self._true.tool_from_lamp
        self._true_camera = self._true.base_from_camera @ self._camera_error()
        self.lens = Lens(
            calibration.width,
            calibration.height,
            self._true.camera_matrix,
            self._true.distortion,
            self._object_from_base @ self._true_camera,
        )
        # Small images have large pixels, which need more samples for the same shadow edges.
        subdivision = 2 if calibration.width >= 400 else 4
        self._cached_lamp_image = lru_cache(CACHED_IMAGES)(self._lamp_image_at)
        self._ambient: Float32Array | None = None
        self._indirect: IndirectLight | None = None
        self.target = object_spec.target(spec, seed, cell)
        if len(self.scene.mesh.triangles):
            self._tracer = Tracer(self.scene.mesh)
        if self.target is not None:
            # Calibrations measure a target's edges to hundredths of a pixel, hence one subdivision more.
            self._stage = TargetStage(self.target, self.lens, subdivision + 1)
            return
        self._view = render.trace_view(self.scene, self._tracer, self.lens, subdivision)
        self._indirect = IndirectLight(self.scene, self._tracer, self._view) if self._profile.interreflections else None
        if self._indirect is not None and self._profile.ambient_per_s > 0:
            self._ambient = self._indirect.ambient()

    def _camera_error(self) -> FloatArray:
        """The profile's error (4, 4) of the camera's pose, in its own frame."""
        random = _generator(self._seed, "camera")
        shift, turn = random.normal(size=(2, 3))
        return geometry.pose(
            self._profile.camera_shift_m * shift / np.linalg.norm(shift),
            self._profile.camera_turn_rad * turn / np.linalg.norm(turn),
        )

    def base_from_flange(self, joints: Sequence[float]) -> FloatArray:
        """The flange's true pose (4, 4) at joints (6,) in rad as the controller states them."""
        flange = np.eye(4)
        true_joints = (np.array(joints) + self._true.joint_offsets).tolist()
        flange[:3] = np.reshape(kinematics.forward(self._arm, true_joints), (3, 4))
        return flange

    def base_from_lamp(self, joints: Sequence[float]) -> FloatArray:
        """The lamp's pose (4, 4) at joints (6,) in rad, independent of the controller's TCP."""
        return self.base_from_flange(joints) @ self._flange_from_lamp

    def lamp_image(self, lamp: Lamp) -> Float32Array:
        """Image (H, W) under a lamp (object frame), without ambient light: direct light and interreflections."""
        image = render.direct_image(self._view, self.scene, self._tracer, lamp)
        return image if self._indirect is None else image + self._indirect.interreflections(lamp)

    def frame(self, intervals: Sequence[ExposureInterval], exposure_s: float, attempt: int) -> npt.NDArray[np.uint16]:
        """The camera's frame (H, W) uint16 of an exposure made of intervals, whose shares sum to 1."""
        profile = self._profile
        is_on = any(moment.lamp_level > 0 for moment in intervals)
        joints = [round(joint / 1e-4) for joint in intervals[0].joints]
        random = _generator(self._seed, joints, repr(exposure_s), is_on, attempt)
        lamp = _generator(self._seed, "lamp", joints, is_on, attempt % FRAMES_APART)
        intensity = self._true.lamp_intensity * (1 + profile.intensity_sigma * lamp.normal())
        shift = profile.lamp_position_sigma_m * lamp.normal(size=3)
        ambient = profile.ambient_per_s * exposure_s * _flicker(exposure_s, random)

        signal = np.zeros((self.lens.height, self.lens.width), dtype=np.float32)
        for moment in intervals:
            power = intensity * exposure_s * moment.share * moment.lamp_level
            if power > 0:
                signal += np.float32(power) * self._cached_lamp_image(tuple(moment.joints), tuple(shift))
        if self.target is not None and ambient > 0:
            for moment in intervals:
                seen = self._stage.ambient_image(self._object_from_mount(moment.joints))
                signal += np.float32(ambient * moment.share) * seen
        elif self._ambient is not None:
            signal += np.float32(ambient) * self._ambient
        if self._sensitivity is not None:
            signal *= self._sensitivity
        if self._channels is not None:
            signal *= self._channels
        return sensor.expose(signal, self.calibration.sensor, random if profile.noise else None)

    def _lamp_image_at(self, joints: tuple[float, ...], shift: tuple[float, ...]) -> Float32Array:
        """Image (H, W) under the lamp at power 1, at joints (6,) in rad and displaced by `shift` (3,) in m."""
        base_from_lamp = self.base_from_lamp(joints)
        base_from_lamp[:3, 3] += shift
        lamp = Lamp.posed(self._object_from_base @ base_from_lamp, 1.0, self.calibration.reference_m, self._true.lobe)
        if self.target is not None:
            return self._stage.lamp_image(lamp, self._object_from_mount(joints))
        return self.lamp_image(lamp)

    def _object_from_mount(self, joints: Sequence[float]) -> FloatArray:
        """Pose (4, 4), object frame, of the mount of the target: the table, or the flange at joints (6,)."""
        if self.target is None or self.target.spec.mount == "table":
            return np.eye(4)
        return self._object_from_base @ self.base_from_flange(joints)

    def save_calibration_truth(self, path: Path) -> None:
        """Writes `calibration_truth.json`, the values that a calibration should find; only graders read it."""
        facts = {} if self.target is None else self.target.facts
        true = replace(self._true, base_from_camera=self._true_camera)
        true.save(path, reference_m=self.calibration.reference_m, **facts)

    def truth(self) -> Truth:
        """Ground truth at the pixel centres, in the view frame of the nominal camera.

        A mirror has normals but no meaningful albedo. A target on the flange has no fixed place, so the mask is empty.
        """
        if not len(self.scene.mesh.triangles):
            empty = np.zeros((self.lens.height, self.lens.width), np.float32)
            none = empty > 0
            return Truth(np.zeros((*empty.shape, 3), np.float32), empty, empty, none, none)
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
        """Mask (H, W) of the pixels whose centre on the object the lamp at joints (6,) lights directly, unshadowed."""
        samples = self._centre_samples()
        position = geometry.transform(self._object_from_base, self.base_from_lamp(joints)[:3, 3])
        result = np.zeros(self.lens.height * self.lens.width, dtype=bool)
        result[samples.pixels] = render.lit_mask(samples.points, samples.normals, position, self._tracer, self.scene)
        return result.reshape(self.lens.height, self.lens.width)

    def _centre_samples(self) -> render.Samples:
        rows, columns = np.divmod(np.arange(self.lens.height * self.lens.width, dtype=float), self.lens.width)
        return render.object_samples(self.scene, self._tracer, self.lens.eye, self.lens.directions(columns, rows))


def _white_of_sites(calibration: Calibration) -> Float32Array | None:
    """Response (H, W) of a mosaic's sites to white, relative to their mean; None if monochrome. Surfaces are grey."""
    pattern = calibration.sensor.mosaic
    if pattern is None:
        return None
    cell = spectra.white()[["rgb".index(letter) for letter in pattern]].reshape(2, 2)
    tiles = (-(-calibration.height // 2), -(-calibration.width // 2))
    return np.tile(cell, tiles)[: calibration.height, : calibration.width].astype(np.float32)


def _generator(*key: object) -> np.random.Generator:
    return np.random.default_rng(int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:16], "big"))


def _flicker(exposure_s: float, random: np.random.Generator) -> float:
    """The room's mean light over an exposure from a random phase of the mains, relative to its long-term mean."""
    phase = random.uniform(0, 2 * np.pi)
    swing = 2 * np.pi * FLICKER_HZ * exposure_s
    wave = (np.sin(phase + swing) - np.sin(phase)) / swing
    return float((1 + DRIFT * random.normal()) * (1 + FLICKER_DEPTH * wave))
