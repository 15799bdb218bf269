"""A lamp with a real LED's lobe over a matt plane: patches as a true camera, arm and plane would give them."""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import geometry
from acquisition.calibrate import plane_shading
from acquisition.calibrate.plane_shading import Known, Placing, PlaneImage
from acquisition.models.base import FloatArray
from hardware_sim import lamp_lobe as true_lobes
from hardware_sim import nominal
from hardware_sim.lamp_lobe import LampLobe
from tests.acquisition.calibrate.mirror_sphere import tools

CALIBRATION = nominal.calibration(512)
ALBEDO, ALBEDO_SIGMA = 0.85, 0.002
LAMP_COVARIANCE = np.diag([4e-4**2] * 3)
CAMERA_COVARIANCE = np.diag([2e-4**2] * 3 + [3e-4**2] * 3)
PLACING_COVARIANCE = np.diag([3e-5**2, 3e-5**2, 2e-4**2, 1e-3**2, 1e-3**2, 1e-4**2])
IMAGE_SIGMA, LAMP_SIGMA_M = 0.005, 3e-4
COARSE, FINE = (0.002, 1e-3), (2.5e-4, 2e-4)
"""1 σ of a patch's brightness that nothing explains, and that the image's noise leaves, as fractions: of paper that is
uneven, and of the simulated cell's."""
WIDTH_M, HEIGHT_M = 0.072, 0.054


@dataclass(frozen=True)
class Truth:
    """True lobe, intensity and flat field (5,), and the true geometry's deviations as `plane_shading` orders them."""

    lobe: LampLobe
    intensity: float
    flat_field: FloatArray
    sag_m: FloatArray

    def factors(self, angles: FloatArray) -> FloatArray:
        """Intensity over that on the axis (N,), its sides left out."""
        along = np.stack([0 * angles, 0 * angles, np.cos(angles)], axis=1)
        return self.lobe.relative(along)


def captured(
    seed: int,
    count: int = 30,
    placings: int = 2,
    tilt_deg: float = 35.0,
    sags: float = 1.0,
    lamp_sigma_m: float = LAMP_SIGMA_M,
    noise: tuple[float, float] = COARSE,
) -> tuple[Truth, list[PlaneImage], list[Placing], Known]:
    """`count` images of each placing of the plane, the lamp tilted by up to `tilt_deg` away from it; the first lies
    flat, others on a wedge. It sags `sags` times as much as the seed says; `lamp_sigma_m`: of the lamp's place in each
    image; `noise`: `COARSE` or `FINE`."""
    random = np.random.default_rng(seed)
    truth = Truth(
        true_lobes.led(random), CALIBRATION.lamp_intensity * (1 + 0.05 * random.standard_normal()),
        0.01 * random.standard_normal(5), 2e-4 * sags * random.standard_normal(2),
    )  # fmt: skip
    lamp = np.array(CALIBRATION.tool_from_lamp)
    lamp[:3, 3] += np.sqrt(np.diag(LAMP_COVARIANCE)) * random.standard_normal(3)
    error = np.sqrt(np.diag(CAMERA_COVARIANCE)) * random.standard_normal(6)
    nominal_camera = np.array(CALIBRATION.base_from_camera)
    camera = nominal_camera @ geometry.pose(error[:3], error[3:])
    albedo = ALBEDO * (1 + ALBEDO_SIGMA * random.standard_normal())
    images: list[PlaneImage] = []
    stated: list[Placing] = []
    for number in range(placings):
        tilt = np.radians(15.0) * (number > 0) * geometry.direction(np.pi / 2, random.uniform(0, 6.3))
        board = geometry.pose((0.55, 0.0, 0.02), tilt) @ geometry.pose((0, 0, 0), (np.pi, 0.0, 0.0))
        board = board @ geometry.pose((-WIDTH_M / 2, -HEIGHT_M / 2, 0.0), (0.0, 0.0, 0.0))
        off = np.sqrt(np.diag(PLACING_COVARIANCE)) * random.standard_normal(6)
        stated.append(Placing(geometry.inverse(nominal_camera) @ board, PLACING_COVARIANCE))
        true_board = camera @ stated[-1].camera_from_board @ geometry.pose(off[:3], off[3:])
        for tool in tools(count, 100 * seed + number, tilt_deg=tilt_deg, slant_deg=60.0):
            here = lamp @ geometry.pose(lamp_sigma_m * random.standard_normal(3), (0.0, 0.0, 0.0))
            images.append(_image(truth, f"{len(images):03}.png", number, tool, (tool @ here, true_board), camera,
                                 albedo, noise, random))  # fmt: skip
    known = Known(CALIBRATION, ALBEDO, ALBEDO_SIGMA, LAMP_COVARIANCE, CAMERA_COVARIANCE, (WIDTH_M, HEIGHT_M))
    return truth, [plane_shading.usable(one, stated[one.placing], CALIBRATION) for one in images], stated, known


def _image(
    truth: Truth, name: str, placing: int, tool: FloatArray, poses: tuple[FloatArray, FloatArray], camera: FloatArray,
    albedo: float, noise: tuple[float, float], random: np.random.Generator,
) -> PlaneImage:  # fmt: skip
    lamp, board = poses
    x, y = np.meshgrid(np.linspace(0.004, WIDTH_M - 0.004, 10), np.linspace(0.004, HEIGHT_M - 0.004, 8))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    across = 2 * points[:, :2] / np.array([WIDTH_M, HEIGHT_M]) - 1
    # Deeper by this than the plane through the border, whose mean depth counts as none.
    depth = (1 - across**2 - 2 / 3 * np.array([WIDTH_M, HEIGHT_M]) / (WIDTH_M + HEIGHT_M)) @ truth.sag_m
    place = geometry.transform(board, points + np.stack([0 * depth, 0 * depth, depth], axis=1))
    projected = cv2.projectPoints(
        geometry.transform(geometry.inverse(camera), place), np.zeros(3), np.zeros(3),
        np.array(CALIBRATION.camera_matrix), np.array(CALIBRATION.distortion),
    )[0]  # fmt: skip
    pixels = np.asarray(projected, np.float64).reshape(-1, 2)
    away = place - lamp[:3, 3]
    distance = np.linalg.norm(away, axis=1)
    direction = geometry.rotate(geometry.inverse(lamp), away / distance[:, None])
    leaning = 2 * truth.sag_m * across / np.array([WIDTH_M / 2, HEIGHT_M / 2])
    into = np.column_stack([leaning, np.ones(len(points))]) @ board[:3, :3].T
    facing = np.einsum("ni,ni->n", away, into) / distance
    shading = np.maximum(facing, 0) * (CALIBRATION.reference_m / distance) ** 2 * truth.lobe.relative(direction)
    half = np.hypot(CALIBRATION.width, CALIBRATION.height) / 2
    u, v = ((pixels - (np.array([CALIBRATION.width, CALIBRATION.height]) - 1) / 2) / half).T
    flat = np.exp(np.stack([u, v, u * u, u * v, v * v], axis=1) @ truth.flat_field)
    own = 1 + IMAGE_SIGMA * random.standard_normal()
    grain = 1 + np.hypot(*noise) * random.standard_normal(len(points))
    values = truth.intensity * albedo * own * shading * flat * grain
    return PlaneImage(name, placing, tool, points, pixels, values, np.full(len(points), noise[1]))
