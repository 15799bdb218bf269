"""Posterior angular variance of each pixel's normal under a set of lights (Bayesian linear design).

The parameters of a sample pixel are (g, ζ), albedo × normal and a scaled depth offset, with the Fisher information of
the images so far as prior. A candidate light adds a design row: its light vector at the pixel, whitened by the noise at
the exposure that the light would get. Whether the pixel will see the light is a probability, of no attached and no cast
shadow, given the uncertainty of the pilot's shape. Three scenarios carry it into the criterion: each regards every
light of probability above its level as visible, because an error of one pixel's normal hides all lights of one side
together. Multiplying information by probability instead would be optimistic (decision 0027).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.recipe import UNPLANNED_FACTOR, Recipe
from acquisition.models.result import LIT, NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.models.tuned import tuned
from acquisition.plan import criterion_kernels, exposure_options, planned_noise, visibility
from acquisition.plan.exposure_options import Exposures
from acquisition.plan.planned_noise import Gloss, Shading
from acquisition.plan.visibility import Surface

VISIBILITY_LEVELS = (1 / 6, 1 / 2, 5 / 6)
"""Visibility probabilities above which a light counts as visible, one for each scenario; decision 0027."""


@dataclass(frozen=True)
class CriterionSettings:
    """Tuned numbers of the design criterion."""

    shadow_sigma: float = tuned(0.05, "1")
    """1 σ of the threshold of a shadow, in cosine of incidence or slope of clearance; combined with the normal's own
    σ. Errors are 0.998 times those with 0.06 for attached and 0.04 for cast shadows (sixteen scenes, eight images)."""


SETTINGS = CriterionSettings()
MIN_COSINE = SolveSettings().shadow_threshold
"""Cosine of incidence below which a pixel counts as in attached shadow: the solver's threshold, a share of the peak."""

MIN_LIGHTS = 3
"""Lights needed to determine a pixel's normal and albedo."""


@dataclass(frozen=True)
class Samples:
    """Sample pixels with their estimates and Fisher information from the images so far."""

    row: np.ndarray  # (P,)
    column: np.ndarray  # (P,)
    point: Float32Array  # (3, P) m, view frame
    ray_direction: Float32Array  # (3, P) ∂x/∂Z
    normal: Float32Array  # (3, P)
    albedo: Float32Array  # (P,)
    sigma: Float32Array  # (P,) rad
    information: FloatArray  # (P, 4, 4) of (g, ζ), weak prior included
    lit: Float32Array  # (P,) images so far in which the pixel is lit
    indirect: Float32Array  # (P,) indirect part of y, mean of the images so far
    offset_sigma_m: float = photometry.SETTINGS.offset_sigma_m  # ζ = 1 is a depth offset of so much

    @cached_property
    def packed(self) -> FloatArray:
        """The upper triangle (10, P) of the information."""
        upper = np.triu_indices(4)
        return np.ascontiguousarray(self.information[:, upper[0], upper[1]].T)

    @property
    def prior(self) -> FloatArray:
        """Information (P, 4, 4) of the weak prior alone."""
        return prior_information(self.albedo)

    @cached_property
    def inverse_albedo2(self) -> Float32Array:
        """1/ρ² (P,)."""
        return (1.0 / self.albedo**2).astype(np.float32)

    def thinned(self, step: int) -> "Samples":
        """Every `step`-th pixel."""
        first = ("row", "column", "albedo", "sigma", "information", "lit", "indirect")
        thinned = {name: getattr(self, name)[::step] for name in first}
        thinned |= {name: getattr(self, name)[:, ::step] for name in ("point", "ray_direction", "normal")}
        return replace(self, **{name: np.ascontiguousarray(value) for name, value in thinned.items()})


@dataclass(frozen=True)
class Candidates:
    """Candidate lights as whitened design rows and visibilities at each sample pixel."""

    row: Float32Array  # (K, 4, P) whitened
    visibility: Float32Array  # (K, P) probability

    def only(self, chosen: list[int] | npt.NDArray[np.intp]) -> "Candidates":
        """Subset of the candidates."""
        return Candidates(np.ascontiguousarray(self.row[chosen]), np.ascontiguousarray(self.visibility[chosen]))

    def thinned(self, step: int) -> "Candidates":
        """Every `step`-th pixel."""
        return Candidates(
            np.ascontiguousarray(self.row[:, :, ::step]), np.ascontiguousarray(self.visibility[:, ::step])
        )


def samples(
    normal_map: NormalMap, calibration: Calibration, chosen: np.ndarray,
    offset_sigma_m: float = photometry.SETTINGS.offset_sigma_m,
) -> Samples:  # fmt: skip
    """Sample pixels of a normal map, by numbers in its `information`, with a prior of their depth offsets in m."""
    rows, columns = normal_map.information.rows[chosen], normal_map.information.columns[chosen]
    ray = visibility.rays_at(calibration, rows, columns)
    depth = normal_map.depth[rows, columns]
    albedo = np.maximum(normal_map.albedo[rows, columns], 1e-3)
    scale = np.array([1.0, 1.0, 1.0, offset_sigma_m])
    information = normal_map.information.matrices[chosen] * np.outer(scale, scale)
    return Samples(
        row=rows,
        column=columns,
        point=photometry.points(ray, depth),
        ray_direction=photometry.ray_directions(ray),
        normal=np.ascontiguousarray(normal_map.normals[rows, columns].T),
        albedo=albedo,
        sigma=np.radians(np.nan_to_num(normal_map.sigma_deg[rows, columns], nan=40.0)).astype(np.float32),
        information=information + prior_information(albedo),
        lit=np.count_nonzero(normal_map.flags[:, rows, columns] & LIT, axis=0).astype(np.float32),
        indirect=np.zeros_like(albedo),
        offset_sigma_m=offset_sigma_m,
    )


def prior_information(albedo: Float32Array) -> FloatArray:
    """Prior information (P, 4, 4): ±`PRIOR_SCALE` ρ of each component of g, ±1 of the scaled depth offset ζ."""
    prior = np.zeros((len(albedo), 4, 4))
    prior[:, (0, 1, 2), (0, 1, 2)] = (1.0 / (photometry.SETTINGS.prior_scale * albedo) ** 2)[:, None]
    prior[:, 3, 3] = 1.0
    return prior


def usable_pixels(normal_map: NormalMap, calibration: Calibration) -> np.ndarray:
    """Numbers of the information's pixels that a plan can use: finite, and among those that error figures count."""
    information = normal_map.information
    rows, columns = information.rows, information.columns
    if not len(rows):
        return np.empty(0, dtype=np.int64)
    ray_direction = photometry.ray_directions(visibility.rays_at(calibration, rows, columns))
    normal = normal_map.normals[rows, columns].T
    cosine = -np.sum(normal * ray_direction, axis=0) / np.sqrt(np.sum(ray_direction * ray_direction, axis=0))
    finite = (
        np.isfinite(information.matrices).all(axis=(1, 2))
        & np.isfinite(normal).all(axis=0)
        & np.isfinite(normal_map.depth[rows, columns])
        & np.isfinite(normal_map.albedo[rows, columns])
        & (normal_map.depth[rows, columns] > 0)
    )
    counted = photometry.inside(normal_map)[rows, columns] & (cosine > np.cos(np.radians(photometry.GRADED_SLANT_DEG)))
    return np.flatnonzero(finite & counted)


def _shading(sample: Samples, lamp: Float32Array, calibration: Calibration) -> Shading:
    light = photometry.light_vectors(sample.point, lamp, calibration)
    length = np.sqrt(np.einsum("fcp,fcp->fp", light, light))
    distance = np.sqrt(np.sum((lamp[:, :3, None] - sample.point[None]) ** 2, axis=1))
    cosine = np.einsum("fcp,cp->fp", light, sample.normal) / np.maximum(length, 1e-9)
    strength = sample.albedo * length
    return Shading(light, strength, distance, cosine, np.maximum(cosine, MIN_COSINE) * strength)


def candidates(
    sample: Samples, lights: list[Light], surface: Surface, calibration: Calibration, recipe: Recipe,
    gloss: Gloss = planned_noise.DIFFUSE, *, exposures: Sequence[Exposures] | None = None,
) -> Candidates:  # fmt: skip
    """Whitened design rows and visibility probabilities of lights at the sample pixels, at each light's own exposures.

    `exposures` None: the automatic one of each light, with planned exposures also one that is `UNPLANNED_FACTOR` times
    as long, until they are planned.
    """
    lamp = photometry.lamps(lights)
    shading = _shading(sample, lamp, calibration)
    visibility_probability = _visibility(sample, shading, surface, lamp)
    if exposures is None:
        seconds = _automatic_seconds(shading, visibility_probability, calibration, recipe)
        factors = (1.0,) if recipe.exposure.plan == "fixed" else (1.0, UNPLANNED_FACTOR)
        exposures = [[FrameExposure(exposure_s=float(one * factor)) for factor in factors] for one in seconds]
    sensor, saturated = _sensor_variance(shading.value, exposures, calibration)
    visibility_probability = np.where(saturated, 0.0, visibility_probability)

    expected = planned_noise.variance(shading, sensor, calibration, sample.indirect)
    if gloss.sigma > 0:
        highlight = shading.strength / sample.albedo * _half_vector_cosine(sample, shading) ** gloss.exponent
        expected = expected + (gloss.sigma * highlight) ** 2
    along = np.einsum("fcp,cp->fp", shading.light, sample.ray_direction) * sample.albedo
    facing = np.einsum("cp,cp->p", sample.normal, sample.ray_direction) * shading.strength
    slope = (3 * shading.cosine * along - facing) / shading.distance * sample.offset_sigma_m
    row = np.concatenate([shading.light, slope[:, None]], axis=1) / np.sqrt(expected)[:, None]
    return Candidates(np.ascontiguousarray(row, np.float32), np.ascontiguousarray(visibility_probability, np.float32))


def automatic_seconds(
    sample: Samples, lights: list[Light], surface: Surface, calibration: Calibration, recipe: Recipe
) -> FloatArray:
    """The automatic exposure time (K,), s, of lights by the sample pixels' expected level."""
    lamp = photometry.lamps(lights)
    shading = _shading(sample, lamp, calibration)
    return _automatic_seconds(shading, _visibility(sample, shading, surface, lamp), calibration, recipe)


def _visibility(sample: Samples, shading: Shading, surface: Surface, lamp: Float32Array) -> FloatArray:
    """Probability (K, P) of neither attached nor cast shadow."""
    sigma = np.hypot(SETTINGS.shadow_sigma, sample.sigma / np.sqrt(2.0))
    return ndtr((shading.cosine - MIN_COSINE) / sigma) * ndtr(surface.clearance(sample.point, lamp) / sigma)


def _automatic_seconds(
    shading: Shading, visibility_probability: FloatArray, calibration: Calibration, recipe: Recipe
) -> FloatArray:
    lit = np.where(visibility_probability > 0.5, shading.value, 0.0)
    brightest = np.maximum(np.quantile(lit, 0.995, axis=1), 1e-4)
    if recipe.exposure.seconds is not None:
        return np.full_like(brightest, recipe.exposure.seconds)
    return recipe.exposure.target / brightest / calibration.lamp_intensity


def _sensor_variance(
    value: Float32Array, exposures: Sequence[Exposures], calibration: Calibration
) -> tuple[FloatArray, BoolArray]:
    """The sensor's part of the variance of values (K, P) by each light's exposures, and which are saturated."""
    variance, saturated = np.empty(value.shape), np.empty(value.shape, np.bool_)
    for number, (one, wanted) in enumerate(zip(value, exposures, strict=True)):
        variance[number], saturated[number] = photometry.merged_variance(one, wanted, calibration)
    return variance, saturated


def _half_vector_cosine(sample: Samples, shading: Shading) -> Float32Array:
    """Blinn's n·h: cosines (K, P) between the normal and the half vector of lamp and camera."""
    to_camera = -sample.ray_direction / np.sqrt(np.sum(sample.ray_direction**2, axis=0))
    half = shading.light / np.maximum(shading.strength / sample.albedo, 1e-9)[:, None] + to_camera
    aligned = np.einsum("fcp,cp->fp", half, sample.normal)
    return np.clip(aligned / np.sqrt(np.einsum("fcp,fcp->fp", half, half)), 0, 1)


def reweight(sample: Samples, normal_map: NormalMap, observations: Observations, calibration: Calibration) -> Samples:
    """Reweights the samples' information from the noise that the solver assumed to the planner's noise model.

    The scale is per pixel. Also fills in the mean indirect part of the images.
    """
    shots = [shot for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    if not shots or len(shots) != len(normal_map.flags):
        return sample
    lamp = photometry.lamps([shot.light for shot in shots if shot.light is not None])
    shading = _shading(sample, lamp, calibration)
    sensor, _ = _sensor_variance(
        shading.value, [exposure_options.of_frames(observations.frames_of(shot)) for shot in shots], calibration
    )
    lit = normal_map.flags[:, sample.row, sample.column] & LIT > 0
    indirect = np.zeros_like(sample.albedo)
    if normal_map.indirect is not None:
        share = np.clip(normal_map.indirect[sample.row, sample.column], 0, 0.5)  # no brighter than the direct light
        indirect = np.asarray(np.mean(np.where(lit, shading.value, 0), axis=0) * share / (1 - share), np.float32)
    assumed = planned_noise.solved_variance(shading, sensor, calibration, indirect, normal_map)
    expected = planned_noise.variance(shading, sensor, calibration, indirect)
    before = np.sum(np.where(lit, shading.strength**2 / assumed, 0.0), axis=0)
    after = np.sum(np.where(lit, shading.strength**2 / expected, 0.0), axis=0)
    scale = np.divide(after, before, out=np.ones_like(before), where=before > 0)
    information = (sample.information - sample.prior) * scale[:, None, None] + sample.prior
    return replace(sample, information=information, indirect=indirect)


@dataclass(frozen=True)
class Posterior:
    """Posterior covariance of all sample pixels in all visibility scenarios, given a set of lights."""

    covariance: Float32Array  # (S, 10, P) of (g, ζ)
    variance: FloatArray  # (S, P) rad²
    lit: Float32Array  # (S, P) lights visible from the pixel, captured ones included

    @property
    def sigma_deg(self) -> FloatArray:
        """Posterior σ (P,), mean over the scenarios, degrees; a result's also has components of the model's errors
        (`expected_sigma`)."""
        return np.degrees(np.mean(np.sqrt(self.variance), axis=0))


def joined(sample: Samples, parts: Sequence[Candidates]) -> Candidates:
    """All candidates of the parts; without parts none."""
    pixels = len(sample.albedo)
    return Candidates(
        np.concatenate([np.empty((0, 4, pixels), np.float32), *(part.row for part in parts)]),
        np.concatenate([np.empty((0, pixels), np.float32), *(part.visibility for part in parts)]),
    )


def posterior(sample: Samples, lights: Candidates, weight: FloatArray | None = None) -> Posterior:
    """Bayesian update: posterior after adding all of `lights` to the prior information, each `weight` (K,) times.

    `weight` None: each once.
    """
    shape = (len(VISIBILITY_LEVELS), len(sample.albedo))
    out = Posterior(
        np.empty((shape[0], 10, shape[1]), np.float32),
        np.empty(shape),
        np.empty(shape, dtype=np.float32),
    )
    criterion_kernels.posterior(
        sample.packed,
        lights.row,
        lights.visibility,
        np.ones(len(lights.row)) if weight is None else weight,
        np.array(VISIBILITY_LEVELS, np.float32),
        sample.normal,
        sample.inverse_albedo2,
        out.covariance,
        out.variance,
        out.lit,
    )
    return replace(out, lit=out.lit + sample.lit)


def without_each(sample: Samples, lights: Candidates, instead: Candidates | None = None) -> Iterator[Posterior]:
    """Leave-one-out: the posterior without each of `lights`, or with the same one of `instead` in its place."""
    for one in range(len(lights.row)):
        others = lights.only(np.delete(np.arange(len(lights.row)), one))
        yield posterior(sample, others if instead is None else joined(sample, [others, instead.only([one])]))


def scan(
    sample: Samples, present: Posterior, lights: Candidates, inverse_cap: float, *, slope: bool = False
) -> FloatArray:
    """Mean of v / (1 + v · inverse_cap) (K,) with each one of `lights` added to the present posterior; or, for `slope`,
    the gradient (K,) of the mean v in their design weights."""
    out = np.empty(len(lights.row))
    criterion_kernels.scan(
        present.covariance,
        present.variance.astype(np.float32),
        lights.row,
        lights.visibility,
        sample.normal,
        sample.inverse_albedo2,
        np.array(VISIBILITY_LEVELS, np.float32),
        inverse_cap,
        slope,
        out,
    )
    return out
