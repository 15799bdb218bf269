"""Per-pixel near-light photometric stereo: iteratively reweighted least squares of albedo × normal.

Measurements that are saturated or in shadow are dropped. In shadow are those below a share of the pixel's own peak
normalised value y/|s|. The threshold is low, because a high one throws away good grazing light. It does not exclude
penumbrae, which lie beside shadowed pixels; measurements there get extra variance. On path-traced objects this has a
fifth less error than a threshold of 15 % without extra variance. Where the images do not decide, a weak Gaussian prior
on g = albedo × normal does, with its mean on the viewing axis, and σ shows it.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from acquisition import image_values, mosaic, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.models.tuned import tuned
from acquisition.mosaic import Sites
from acquisition.normals.pixels import pixel_solve_kernels, robust_solve, term_solve
from acquisition.normals.pixels.estimate import Estimate
from acquisition.normals.pixels.image_terms import ImageTerms, TermValues
from acquisition.normals.pixels.robust_solve import Classified, PixelProblem
from acquisition.normals.pixels.term_solve import TermProblem


@dataclass(frozen=True)
class PixelSolveSettings:
    """Tuned numbers of the solve of single pixels."""

    penumbra_sigma: float = tuned(0.1, "of the peak")
    """1 σ added in the eight neighbours of shadowed pixels, as a share of the pixel's peak value. Half or twice as much
    changes the mean error on path-traced objects by 1–2 %."""


SETTINGS = PixelSolveSettings()


@dataclass(frozen=True)
class Scene:
    """What solves take as given.

    - `lamps` (F, 6 or 9): as of `photometry.lamps`.
    - `noise`: the noise model; `stated_noise`: that of sensor and calibration if `noise` is estimated; none: `noise`.
    - `terms`: those beyond Lambert's; none: neither they nor their derivatives are solved for.
    - `median_albedo`: that of the whole object if the pixels at hand are a part of it; none: theirs.
    - `common_lamp_errors_m` (F, 3, C): displacement of each lamp by 1 σ of each error of the calibration that all lamps
      share, as of `lamp_pose.common_errors`; none: unknown.
    - `shadows_informative`: whether shadows show ambient and stray light; not if it is below black and censored there.
    """

    lamps: Float32Array
    calibration: Calibration
    noise: image_values.Noise
    settings: SolveSettings = field(default_factory=SolveSettings)
    median_albedo: float | None = None
    terms: ImageTerms | None = None
    common_lamp_errors_m: FloatArray | None = None
    stated_noise: image_values.Noise | None = None
    shadows_informative: bool = True

    @property
    def stores_black_as_zero(self) -> bool:
        """Whether values are left-censored at black, because without a black level nothing darker can be stored."""
        return self.calibration.sensor.black_level_dn == 0

    def response(self, channel: Sites | None) -> Float32Array | None:
        """Returns values (N,) of white at a mosaic's sites of these channels (N,), over the mean; none: no mosaic."""
        return None if channel is None else mosaic.white(self.calibration)[channel]

    @property
    def cauchy_scale(self) -> float | None:
        """Scale of Cauchy's weights by the settings; none: least squares."""
        return photometry.CAUCHY_SCALE if self.settings.robust else None


@dataclass(frozen=True)
class Pixels:
    """Measurements at N object pixels of an (h, w) window; `index` (N,) are their flat indices in it, row by row."""

    shape: tuple[int, int]
    index: np.ndarray
    ray: Float32Array  # (2, N) X/Z and Y/Z
    values: Float32Array  # (F, N) normalised values y
    clipped: BoolArray  # (F, N) saturated
    channel: Sites | None = None  # (N,) of a mosaic's sites; none: no mosaic
    sky: Float32Array | None = None  # (N,) sky view factor; none: the whole sky
    extra: Float32Array | None = None  # (F, N) sensor variance beyond the noise model's; none: zero

    def image(self, values: np.ndarray, outside: float = 0.0) -> np.ndarray:
        """Scatters values (..., N) into an image (..., h, w) of the window."""
        out = np.full((*values.shape[:-1], self.shape[0] * self.shape[1]), outside, dtype=values.dtype)
        out[..., self.index] = values
        return out.reshape(*values.shape[:-1], *self.shape)

    def take(self, image: np.ndarray) -> np.ndarray:
        """Gathers the values (..., N) of an image (..., h, w) at the object's pixels."""
        return np.take(image.reshape(*image.shape[:-2], -1), self.index, axis=-1)

    def subset(self, chosen: np.ndarray) -> "Pixels":
        """Returns the pixels with the numbers `chosen` (K,)."""
        return replace(
            self,
            index=self.index[chosen],
            ray=np.ascontiguousarray(self.ray[:, chosen]),
            values=np.ascontiguousarray(self.values[:, chosen]),
            clipped=self.clipped[:, chosen],
            channel=None if self.channel is None else self.channel[chosen],
            sky=None if self.sky is None else self.sky[chosen],
            extra=None if self.extra is None else np.ascontiguousarray(self.extra[:, chosen]),
        )

    def plus_extra(self, variance: Float32Array) -> Float32Array:
        """Returns the sum of a variance (F, N) beside the noise model's and the sensor's own beyond that model."""
        return variance if self.extra is None else variance + self.extra


def depth_derivative(
    light: Float32Array, point: Float32Array, ray_direction: Float32Array, lamps: Float32Array
) -> Float32Array:
    """Returns the derivative ∂s/∂Z (F, 3, N) of near-light vectors by depth, with the lobe's fall-off held constant.
    Light vectors `light` (F, 3, N) are at `point` (3, N), `ray_direction` (3, N) is ∂x/∂Z, lamps are (F, 6 or 9)."""
    out = np.empty(light.shape, np.float32)
    pixel_solve_kernels.depth_derivative(
        np.ascontiguousarray(light, np.float32),
        np.ascontiguousarray(point),
        np.ascontiguousarray(ray_direction),
        lamps,
        out,
    )
    return out


@dataclass(frozen=True)
class Lighting:
    """Light vectors s (F, 3, N) of a scene's lamps at points (3, N) in m, with ∂x/∂Z (3, N) and unit directions to the
    camera (3, N), all in the view frame."""

    light: Float32Array
    point: Float32Array
    ray_direction: Float32Array
    view: Float32Array

    @classmethod
    def at(cls, pixels: Pixels, depth_m: Float32Array, scene: Scene) -> "Lighting":
        """Returns the lighting of pixels at depth (N,) in m."""
        ray_direction = photometry.ray_directions(pixels.ray)
        point = ray_direction * depth_m
        light = photometry.light_vectors(point, scene.lamps, scene.calibration)
        return cls(light, point, ray_direction, photometry.towards_camera(ray_direction))


def classify_measurements(pixels: Pixels, values: Float32Array, light: Float32Array, threshold: float) -> Classified:
    """Classifies measurements as usable, shadowed or saturated, by a threshold relative to each pixel's peak.

    Takes `values` y (F, N) and light vectors s (F, 3, N). Returns the usable measurements (F, N), the variance (F, N)
    of those with a shadowed pixel among their eight neighbours, and the peak y/|s| (N,).
    """
    peak = _peak_ratio(values, light, pixels.clipped)
    row, column = np.divmod(pixels.index, pixels.shape[1])
    width = pixels.shape[1] + 2
    usable, variance = np.empty(values.shape, np.bool_), np.empty(values.shape, np.float32)
    pixel_solve_kernels.classify(
        np.ascontiguousarray(values, np.float32), light, np.ascontiguousarray(pixels.clipped), peak, threshold,
        (row + 1) * width + column + 1, width, SETTINGS.penumbra_sigma, usable, variance,
    )  # fmt: skip
    return Classified(usable, variance, peak)


def _peak_ratio(values: Float32Array, light: Float32Array, clipped: BoolArray) -> Float32Array:
    """Returns each pixel's largest y/|s| (N,) that is not clipped, from values (F, N) and light vectors s (F, 3, N)."""
    out = np.empty(values.shape[1], np.float32)
    pixel_solve_kernels.peak_ratio(
        np.ascontiguousarray(values, np.float32), light, np.ascontiguousarray(clipped), out
    )  # fmt: skip
    return out


def median_albedo(estimate: Estimate, values: Float32Array, clipped: BoolArray) -> float:
    """Returns a lower bound of the albedo: the median over pixels of the largest y/|s| that is not `clipped`."""
    return _median(_peak_ratio(values, estimate.light, clipped))


def _median(peak: Float32Array) -> float:
    """Returns the median; 0 of no pixels, as where all are left out of a sample."""
    return float(np.median(peak)) if peak.size else 0.0


def least_prior_albedo(median: float) -> float:
    """Returns the least albedo of the prior of a pixel's g: a fifth of the object's median."""
    return max(0.2 * median, 1e-6)


def solve(
    pixels: Pixels,
    values: Float32Array,
    depth_m: Float32Array,
    scene: Scene,
    *,
    iterations: int = robust_solve.IRLS_ITERATIONS,
    extra_variance: Float32Array | None = None,
) -> Estimate:
    """Solves for g at each of N pixels at depth (N,) by iteratively reweighted least squares (Cauchy weights).

    `values` (F, N) replace the measured ones where intensities were divided out or light subtracted. `extra_variance`
    (F, N) is added to the noise model's and the pixels' own.
    """
    lighting = Lighting.at(pixels, depth_m, scene)
    return solve_lit(pixels, values, lighting, scene, iterations=iterations, extra_variance=extra_variance)


def solve_lit(
    pixels: Pixels,
    values: Float32Array,
    lighting: Lighting,
    scene: Scene,
    *,
    iterations: int = robust_solve.IRLS_ITERATIONS,
    extra_variance: Float32Array | None = None,
) -> Estimate:
    """Solves as `solve`, in a known `lighting`, which serves for all solves at one depth."""
    light = lighting.light
    if scene.terms is None:
        return _solve(pixels, values, lighting, light, scene, iterations, extra_variance)

    def once(terms: TermValues) -> Estimate:
        extra = extra_variance
        if scene.terms is not None and scene.terms.specular:
            extra = terms.highlight_variance if extra is None else extra + terms.highlight_variance
        return _solve(pixels, values, lighting, light + terms.by_g, scene, iterations, extra, terms)

    response = scene.response(pixels.channel)
    return term_solve.solve(
        TermProblem(values, pixels.clipped, light, lighting.view, scene.noise, scene.terms, once, response, pixels.sky)
    )


def _solve(
    pixels: Pixels, values: Float32Array, lighting: Lighting, bent: Float32Array, scene: Scene,
    iterations: int, extra_variance: Float32Array | None, terms: TermValues | None = None,
) -> Estimate:  # fmt: skip
    """Solves once with given design rows `bent` (F, 3, N), s + ∂h/∂g. The value of the `terms` is subtracted to
    classify measurements, its constant part to solve."""
    lambertian = values if terms is None else values - terms.value
    values = values if terms is None else values - terms.constant

    def classify(clipped: BoolArray) -> Classified:
        without = replace(pixels, clipped=clipped)
        return classify_measurements(without, lambertian, lighting.light, scene.settings.shadow_threshold)

    classified = classify(pixels.clipped)
    typical = _median(classified.peak) if scene.median_albedo is None else scene.median_albedo
    extra = pixels.extra if extra_variance is None else pixels.plus_extra(extra_variance)
    problem = PixelProblem(
        values=values, by_g=bent, light=lighting.light, point=lighting.point, view=lighting.view, extra=extra,
        terms=terms, response=scene.response(pixels.channel), sky=pixels.sky, noise=scene.noise,
        least_albedo=least_prior_albedo(typical), cauchy_scale=scene.cauchy_scale, iterations=iterations,
    )  # fmt: skip
    return robust_solve.solve(problem, pixels.clipped, classified, classify)


def clamp_to_visible(normals: Float32Array, ray_direction: Float32Array) -> Float32Array:
    """Rotates normals (3, N) just far enough towards the camera that each is visible (cosine ≥ `min_view_cosine`)."""
    axis = photometry.towards_camera(ray_direction)
    cosine = np.sum(normals * axis, axis=0)
    least = np.float32(photometry.SETTINGS.min_view_cosine)
    visible = normals + np.maximum(least - cosine, 0) * axis
    return (visible / np.sqrt(np.sum(visible * visible, axis=0))).astype(np.float32)


def normal_perturbation(estimate: Estimate, right: FloatArray) -> FloatArray:
    """Returns first-order rotations (N, 3, K) of normals, rad, by measurement errors δy (implicit differentiation).

    `right` = Σ w r δy (N, 3, K), with the design rows r, is what they add to the right-hand side of the normal
    equations.
    """
    s, w, g = (part.astype(np.float64) for part in (estimate.rows, estimate.weights, estimate.g))
    matrix = np.einsum("fn,fan,fbn->nab", w, s, s, optimize=True)
    matrix += (1e-6 * np.trace(matrix, axis1=1, axis2=2) + 1e-12)[:, None, None] * np.eye(3)
    albedo = np.sqrt(np.maximum(np.sum(g * g, axis=0), 1e-12))
    normal = g / albedo
    moved = np.linalg.solve(matrix, right) / albedo[:, None, None]
    return moved - normal.T[:, :, None] * np.einsum("an,nak->nk", normal, moved)[:, None, :]


def normal_equations(estimate: Estimate, values: Float32Array) -> Float32Array:
    """Returns the normal equations (N, 9) of g by the values (F, N) it was solved from, with the weights used and no
    prior. Columns are the matrix's xx, xy, xz, yy, yz, zz, and the right-hand side's x, y, z."""
    rows, terms = estimate.rows, estimate.terms
    if terms is not None:
        values = values - terms.constant
    weighted = estimate.weights[:, None] * rows
    columns = (rows[:, 0], rows[:, 1], rows[:, 2], values)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3))
    sums = [np.einsum("fn,fn->n", weighted[:, a], columns[b]) for a, b in pairs]
    return np.stack(sums, axis=1, dtype=np.float32, casting="same_kind")


def fisher_information(
    estimate: Estimate, chosen: np.ndarray, lamps: Float32Array, ray_direction: Float32Array
) -> FloatArray:
    """Returns the Fisher information (K, 4, 4) of (g, Z) at chosen pixels by images alone, with the weights used."""
    light = estimate.light[:, :, chosen]
    change = depth_derivative(light, estimate.point[:, chosen], ray_direction[:, chosen], lamps)
    slope = np.einsum("fck,ck->fk", change, estimate.g[:, chosen])
    rows = np.concatenate([estimate.rows[:, :, chosen], slope[:, None]], axis=1).astype(np.float64)
    return np.einsum("fk,fak,fbk->kab", estimate.weights[:, chosen].astype(np.float64), rows, rows, optimize=True)
