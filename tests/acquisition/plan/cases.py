"""Test cases of the planner: synthetic ones with random design rows, and normal maps of scenes with known truth."""

from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import LIT, FisherInformation, NormalMap
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.plan import planned_images, sample_pixels, visibility
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.planned_images import PlannedImages
from tests.acquisition.scenes import Frames, Scene

NO_OBSERVATIONS = Observations(shots=[], darks={}, frames=Frames())


def facing_camera(rng: np.random.Generator, count: int, widest_deg: float = 70) -> FloatArray:
    """Unit normals (3, count), uniform by area within a cone about the view axis."""
    cosine = rng.uniform(np.cos(np.radians(widest_deg)), 1, count)
    azimuth = rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])


def pixels_with(normal: FloatArray, albedo: FloatArray, information: FloatArray) -> Samples:
    """Sample pixels of normals (3, P), albedo (P,) and information (4, 4, P), all else zero."""
    none = np.zeros(len(albedo), np.float32)
    return Samples(
        row=np.zeros(len(albedo), np.int64),
        column=np.zeros(len(albedo), np.int64),
        point=np.zeros(normal.shape, np.float32),
        ray_direction=np.zeros(normal.shape, np.float32),
        normal=normal.astype(np.float32),
        albedo=albedo.astype(np.float32),
        information=np.ascontiguousarray(information),
        light_count=none,
        indirect=none,
        margin=np.zeros(len(albedo)),
    )


def random_case(seed: int, pixels: int = 20, lights: int = 6) -> Candidates:
    """Random pixels with random prior information, and random design rows, some of them hidden."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(pixels, 4, 4)) * 20
    information = np.moveaxis(half @ half.transpose(0, 2, 1) + 5 * np.eye(4), 0, 2)
    samples = pixels_with(facing_camera(rng, pixels), rng.uniform(0.2, 0.9, pixels), information)
    row = rng.normal(size=(lights, 4, pixels)) * 60 * (rng.random((lights, 1, pixels)) < 0.6)
    return Candidates(samples, row.astype(np.float32))


def distant_case(normal: FloatArray, units: FloatArray, scale: float = 1000.0) -> Candidates:
    """Pixels of normals (3, P) lit by distant unit lights (K, 3) with noise 1/`scale`, and a weak prior."""
    pixels = normal.shape[1]
    samples = pixels_with(normal, np.ones(pixels), np.repeat(np.eye(4)[..., None], pixels, axis=2))
    row = np.zeros((len(units), 4, pixels), np.float32)
    row[:, :3] = scale * units[:, :, None]
    return Candidates(samples, row)


def lit_case(seed: int, units: FloatArray, pixels: int = 200) -> Candidates:
    """Pixels with attached and cast shadows of distant lights, at a normal uncertainty of 3°."""
    rng = np.random.default_rng(seed)
    normal = facing_camera(rng, pixels)
    options = distant_case(normal, units, scale=80.0)
    cosine = units @ normal
    hidden = rng.random((pixels, 3)) - 0.5  # each pixel has a side from which lights are occluded
    blocked = units @ np.stack([hidden[:, 0], hidden[:, 1], 0 * hidden[:, 2]]) > 0.25
    seen = (cosine > 0.08) & ~blocked
    return replace(options, row=options.row * seen[:, None])


def shot_of(light: Light, number: int) -> Shot:
    """The record of an image of one light; there is no file."""
    return Shot(
        key=ShotKey(pass_number=0, number=number),
        kind="light",
        frame=FrameRef(path=f"{number}.tiff", width=128, height=128, sha256=""),
        exposure_s=0.05,
        light=light,
        taken_at=0.0,
        quality=FrameQuality(saturated=0.0, bright_level=0.8, accepted=True),
    )


def design_rows(
    samples: Samples, lights: list[Light], normal_map: NormalMap, known: Calibration, recipe: Recipe | None = None
) -> Candidates:
    """Design rows of lights at sample pixels of a normal map, as they are."""
    images = PlannedImages(visibility.surface(normal_map, known), known, (recipe or Recipe()).exposure)
    return images.candidates(replace(samples, margin=np.zeros(len(samples.row))), lights)


def known_map(true: Scene, lights: list[Light], sigma_deg: float = 1.0, step: int = 3) -> NormalMap:
    """The true normal map of a scene, with the Fisher information that images of `lights` would give, and flags of
    which pixels they light."""
    known = true.calibration
    height, width = true.mask.shape
    rows, columns = np.nonzero(true.graded)
    rows, columns = rows[::step].astype(np.int64), columns[::step].astype(np.int64)

    def of_object(values: np.ndarray, outside: float = 0.0) -> np.ndarray:
        mask = true.mask if values.ndim == 2 else true.mask[..., None]
        return np.where(mask, values, outside).astype(np.float32)

    def made(matrices: FloatArray, flags: np.ndarray) -> NormalMap:
        return NormalMap(
            normals=of_object(true.normals),
            albedo=of_object(true.albedo),
            depth=of_object(true.depth),
            sigma_deg=of_object(np.full((height, width), sigma_deg), np.nan),
            residual=np.zeros((height, width), np.float32),
            mask=true.mask,
            silhouette=true.mask,
            flags=flags,
            intensity_factors=np.ones(len(lights)),
            information=FisherInformation(rows=rows, columns=columns, matrices=matrices),
            doubtful=np.zeros_like(true.mask),
        )

    flags = np.zeros((len(lights), height, width), np.uint8)
    blank = made(np.zeros((len(rows), 4, 4)), flags)
    if not lights:
        return blank
    samples = sample_pixels.samples(blank, known, np.arange(len(rows)))
    design = design_rows(samples, lights, blank, known)
    flags[:, rows, columns] = np.where(design.visible, LIT, 0)
    row = design.row.astype(float)
    row[:, 3] /= photometry.SETTINGS.depth_sigma_m
    return made(np.einsum("kap,kbp->pab", row, row), flags)


def vectors_by_hand(true: Scene, light: Light, rows: np.ndarray, columns: np.ndarray) -> FloatArray:
    """Light vectors (3, K) at pixels of a scene, by an independent implementation."""
    known = true.calibration
    offset = np.array(light.position)[:, None] - true.points[:, rows, columns]
    r = np.linalg.norm(offset, axis=0)
    lobe = (-np.array(light.axis) @ (offset / r)) ** known.lobe_exponent
    return known.reference_m**2 * lobe * offset / r**3


def noise_by_hand(
    true: Scene, level: float, value: FloatArray, cosine: FloatArray, strength: FloatArray, distance: FloatArray
) -> FloatArray:
    """Variance of values exposed so that y = 1 gives `level` of full scale, from the planner's constants."""
    known, sensor = true.calibration, true.calibration.sensor
    electrons = sensor.gain_e_per_dn * sensor.full_scale_dn * level
    turn = (known.lamp_position_sigma_m / distance) ** 2 * (1 - cosine**2)
    floor = 2 * (sensor.read_noise_e**2 + sensor.gain_e_per_dn**2 / 12) / electrons**2
    own = value / electrons + floor + photometry.SETTINGS.flat_field_sigma**2 * value**2
    return planned_images.INTEGRABILITY_SHARE * own + turn * strength**2
