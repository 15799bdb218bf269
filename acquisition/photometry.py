"""The image-formation model that planner and solver share, so that what is planned is what is solved.

A Lambertian point x with normal n and albedo ρ, lit by a lamp at p with axis a, gives the normalised value

    y = ρ max(0, n·s),   s = (R0/r)² cosᵘ(a, x − p) d/r,   d = p − x, r = |d|,

the signal as a fraction of that of a perfectly white surface that faces the lamp on its axis at R0. If the lobe is
calibrated, its deviation from the power of the cosine multiplies s (`lobe_table`). The model is near light throughout:
a lamp on an arm stands at three object sizes, where a distant-light model is wrong by 20°. `image_values` has the
variance of y.

Pixels are those of the camera's distorted image; their rays are free of distortion. Kernels compile at import, into
numba's cache; `KERNELS` lists them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numba
import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from acquisition.geometry import VIEW_FROM_CAMERA
from acquisition.models.base import BoolArray, Float32Array, FloatArray, FloatT
from acquisition.models.calibration import Calibration, LampLobe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.result import ModelFinding, NormalMap
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class SharedSettings:
    """Tuned numbers that planner and solver share: priors, and factors of σ."""

    depth_sigma_m: float = tuned(0.002, "m")
    """1 σ of a pixel's depth after integration. It is the prior of the depth offset, a nuisance parameter beside g in
    forecasts and score tests, and enters the direction term of the noise. Measured: depth maps of three path-traced
    objects err by 0.3, 1.5 and 2.6 mm (standard deviation; prototype, November 2026)."""
    prior_scale: float = tuned(0.5, "of the albedo")
    """1 σ of the weak prior of g = ρn, in units of the albedo. It keeps σ finite (about 40°) where no light reaches.
    Half of the albedo in both tangential directions is 0.5 √2 rad = 40°, near the 49° of a random visible normal.
    Measurements outweigh the prior, since they are known to a few per cent."""
    flat_field_sigma: float = tuned(0.005, "share")
    """1 σ of the remaining error of flat field and lobe, as a fraction. Indirect light of less than twice this
    fraction, at the 98th percentile of pixels, is not subtracted. Lobes of single pixels, and their normals in rad,
    have no smaller σ. A judgement that holds: lobes out to 40° of 19 simulated calibrations err by 0.2 % in the median
    and 0.7 % at worst (`docs/how-to/calibrate.md`, November 2026). If indirect light is subtracted from 0.005 on, a
    rough ball under 96 lights errs by 0.59° in place of 0.33° (`gloss_scenes`)."""
    integrated_depth_sigma_m: float = tuned(0.01, "m")
    """1 σ of integrated depth in self-calibration and in the search for lights. Depth is wrong by that much behind
    occluding contours. With 3 mm, thousands of pixels explain this error by a shift and wrong intensities (12 mm in
    place of 5 mm, and 2 %, on a figure). A large value also makes plans even, since wrong depth biases normals unless
    lights surround the object. Measured: errors of eight images are 0.963 ± 0.016 and 1.009 ± 0.021 of those of plans
    with 3 mm and a penalty on imbalance, on fourteen and nine path-traced objects."""
    min_view_cosine: float = tuned(0.05, "cosine")
    """Least cosine between normal and viewing ray, of 87°. Slopes, lobes and normals beyond it are taken at it. An
    object may be hollow if its outwardness is below minus this value. Measured: minus the outwardness is at most 0.03
    on 16 sound objects (design seeds 60 and 62), 0.02 on a glossy relief (102), which opposite lamps would fit, and 0.2
    on a hollow sheet (43)."""
    significant_deviations: float = tuned(5.0, "σ")
    """Deviation from the expected value, in σ, that is not noise even among millions of pixels. It separates an object
    from its background, and a highlight from the diffuse prediction. Measured: silhouettes of 432 simulated objects
    before tables have a mean overlap (IoU) of 0.964 with 5 and 0.963 with 6 (scratch evaluation, November 2026)."""
    outlying_deviations: float = tuned(3.0, "σ")
    """Deviation, in σ, above which something is an outlier. Of Gaussian deviations 0.3 % are larger. It limits:

    (pixels) the rms residual above which a pixel is solved from a second start; the cost of a measurement in shadow to
    a solution with gloss; biweights in the regression on neighbours; deviations of normals at a line narrower than a
    pixel; the relative noise of a value with clipped channels;

    (images) the misfit, against that of the others, above which an image is left out on trial; the intensity under the
    widest prior beyond which it is scaled; intensities, or their scatter, against the stated σ; the noise of
    intensities of a sound capture; measurements below zero after subtraction of light from elsewhere;

    (object) its largest shift; the light in cast shadows that counts as from below the surface; the gain of turned
    lamps, which is 0–2 on sound captures and 4–13 where lamps are 10° off, but 1.6 on machined parts (design seeds 60,
    62 and 63, ten lights, November 2026)."""
    grazing_cosine: float = tuned(0.4, "cosine")
    """Cosine of incidence, of 66°, below which light counts as grazing. Measurements above it determine the noise of
    intensities, those below it that of directions; surfaces steeper than such light are walls. The same share of a
    pixel's largest value, or of its direct or indirect light where these are known, separates light from shadow.
    Measured: if one lamp alone reaches a pixel, the next value is 0.03–0.17 of the largest (10–90 %), if three do, 0.75
    and more. With 0.5 in the noise alone, σ is 1.6 and 2.7 times as large on a machined part and on a cluster (design
    seeds 45 and 21, eight lights by two rings; scratch evaluation, November 2026)."""
    min_pixel_share: float = tuned(0.08, "share")
    """Least share of the object's pixels for a statistic of its shadows or of grazing light. Light that the walls of
    one recess send into their shadow looks like translucency: on 4–5 % of a turned object it gave a coefficient of 1.4
    (Lambertian design seed 6), while translucent objects that were recognised had 9 % and more. Where light grazes only
    edges, as on machined parts, errors are not those of lamp directions and would make σ of all faces too large:
    P(e < σ) is 0.96 without this limit, 0.69 with it (design seed 62, eight lights). The misfit of the whole object
    leaves out the same share of pixels, those that fit worst: creases and the borders of shadows (decision 88)."""
    edge_px: int = tuned(2, "px")
    """Width of an edge in the images. Within it a sharp shadow border passes from dark to lit. A shadow determines
    depth only if it is longer and contradicts the depth by more than this width, since relief is full of short shadows
    that do not; a bound by a shadow leaves this width out. The rim of this width along the silhouette distinguishes
    inside from outside by its normals. Measured: with a rim of 3, 27 captures of design seeds 101–104 are solved alike;
    bounds that leave out half a pixel multiply errors of 128 captures (201–204) by 1.000 ± 0.005 (November 2026)."""
    min_sample: int = tuned(50, "measurements")
    """Number of pixels or measurements below which no statistic of them is estimated. From 50 Gaussian values, a
    standard deviation has a standard error of 10 % (1/√(2 · 50)), a median one of 0.18 σ."""
    predicted_indirect_sigma: float = tuned(0.1, "share")
    """1 σ of the part of the predicted indirect light that differs from light to light, as a share of it. It weights
    measurements. On metal, whose neighbours' mirror images are not predicted, a share of what mirrors the lamp."""
    predicted_light_sigma: float = tuned(0.2, "share")
    """1 σ of light that is predicted beside diffuse reflection, as a share of it: of a highlight, once the lobe is
    known, and of a pixel's indirect light under all lights alike. Measured: at the true shape, the prediction is
    0.80–0.97 of the indirect light of five path-traced objects, since the camera does not see all surfaces
    (November 2026)."""
    misfit_factor: float = tuned(0.1, "1")
    """B, by which misfit raises a pixel's variance (1 + B m χ² (ε + ε̄)) σ₀². σ₀² is the variance of the posterior, m
    the number of lights, χ² the misfit of the pixel's own images, ε the excess of squared whitened residuals round it
    over what the stated noise explains, ε̄ the same of all pixels that face the camera. Measured on 66 captures of
    design seeds 557–562 (eight families, 6, 8 and 20 lights by two rings): the mean log-likelihood of errors is higher
    by 0.005 with 0.05 and lower by 0.033 with 0.2; P(e < 2σ) is 0.932 and 0.950, and 0.941 with this value.
    `normals.uncertainty.error_variance` has the model, decision 101 the fit."""
    unchecked_sigma_deg: float = tuned(8.0, "deg")
    """E, 1 σ of a normal that nothing has checked: fewer than four lights are usable, or the capture has a fault that
    could not be corrected. Measured on 118 captures with a fault or metal left in (design seeds 70–73, eight lights, no
    model selection): P(e < σ) is 0.62 with 5°, 0.70 with 8° and 0.78 with 12°, P(e < 2σ) 0.86, 0.92 and 0.96, and the
    largest rms e/σ 2.5, 2.1 and 1.7. For few lights 9° is likeliest (scratch evaluations, November 2026). Lobes of
    single pixels start on a ring of this radius round the last model's normals, 8° off on lacquer (decision 35)."""
    many_lights: int = tuned(24, "lights")
    """Number of lights from which a highlight is in several images of a pixel. From then on, a pixel is also solved
    without the brightest quarter of them, and a reflectance can be fitted to each pixel (seven unknowns). Under twenty
    lights, omitting the quarter is worse on parts with walls: 2.7° in place of 2.3° on the matt part."""

    @property
    def weakly_checked_sigma_deg(self) -> float:
        """Half of E, degrees: 1 σ of the normals of metal, where a pixel has little but its highlights; and σ of the
        normals whose weight in the integration is half of that of normals without errors."""
        return self.unchecked_sigma_deg / 2


SETTINGS = SharedSettings()

METAL, GREY_TILE = "metal", "grey tile"
"""Kinds of two findings: that the surface is metal, and that of the grey tile, on which no normal depends."""

PIXEL_UNKNOWNS = 3
"""Unknowns of a pixel by which the degrees of freedom of its residuals are reduced: albedo × normal."""

OVERDETERMINED, REDUNDANT = PIXEL_UNKNOWNS + 1, PIXEL_UNKNOWNS + 2
"""Numbers of usable lights from which residuals are informative, and from which they are so without any one light."""

GAUSSIAN_MEDIAN_DEVIATION = 0.6745
"""Median absolute deviation of a Gaussian, in σ."""

CAUCHY_SCALE = 2.385
"""Scale of Cauchy's weight, in σ: 95 % efficiency on Gaussian noise (Holland & Welsch, Commun. Stat. A6, 1977)."""

LOBE_SAMPLES = 1025
"""Number of samples of a lobe's factor over the cosine. Linear interpolation between them is accurate to 1e-5."""

UNDISTORTION_ROUNDS, UNDISTORTION_STEP = 100, 1e-8
"""Largest number of fixed-point iterations that invert the lens distortion, and the step of a ray that ends them. Usual
lenses take five, as OpenCV's `undistortPoints` always does, which leaves wide ones 3 pixels off in the corners."""

RANDOM_NORMAL_SIGMA_DEG = float(np.degrees(np.sqrt(np.pi**2 / 8 - 0.5)))
"""Rms angle, 49°, between the viewing ray and the normals of the visible surface of any convex body, whose density is
sin 2θ. It is 1 σ of a normal on which no image has any information."""

RANDOM_NORMAL_VARIANCE = np.radians(RANDOM_NORMAL_SIGMA_DEG) ** 2
"""The same as a variance, rad²."""

GRADED_SLANT_DEG = 78.0
"""Greatest angle between a normal and its viewing ray over which errors and σ are averaged."""


def bounded_variance(variance_deg2: FloatArray) -> FloatArray:
    """Combines the variance (...), deg², of normals by the images with that of a random visible normal: precisions add.

    Without it, a pixel that is hardly lit and fits badly has a larger variance than visible normals can have.
    """
    random = RANDOM_NORMAL_SIGMA_DEG**2
    return variance_deg2 * random / (variance_deg2 + random)


def capture_sigma_deg(findings: Sequence[ModelFinding]) -> float:
    """1 σ, degrees, that the findings of a capture add to all its normals: E for uncorrected findings, half of E for a
    metal that fits (decision 70)."""
    if any(not finding.corrected and finding.kind != GREY_TILE for finding in findings):
        return SETTINGS.unchecked_sigma_deg
    metal = any(finding.kind == METAL for finding in findings)
    return SETTINGS.weakly_checked_sigma_deg if metal else 0.0


def rays(calibration: Calibration, rows: slice, columns: slice) -> Float32Array:
    """Rays (2, h, w) of a window of pixels: X/Z and Y/Z in the OpenCV camera frame, lens distortion removed."""
    return camera_rays(np.array(calibration.camera_matrix), np.array(calibration.distortion), rows, columns)


def camera_rays(matrix: FloatArray, distortion: FloatArray, rows: slice, columns: slice) -> Float32Array:
    """`rays` of a camera with matrix K (3, 3) and OpenCV's distortion (5,)."""
    out = np.empty((2, rows.stop - rows.start, columns.stop - columns.start), np.float32)
    _undistorted_rays(
        np.ascontiguousarray(matrix, np.float64), np.ascontiguousarray(distortion, np.float64), rows.start,
        columns.start, out,
    )  # fmt: skip
    return out


def ray_directions(ray: Float32Array) -> Float32Array:
    """Derivative ∂x/∂Z (3, ...), view frame, of a pixel's point by its depth, from rays (2, ...)."""
    sign = np.diag(VIEW_FROM_CAMERA)[:3].astype(np.float32)
    return np.stack([sign[0] * ray[0], sign[1] * ray[1], np.full_like(ray[0], sign[2])])


def points(ray: Float32Array, depth_m: Float32Array) -> Float32Array:
    """Points (3, ...) in m, view frame, of pixels with rays (2, ...) and depth (...) along OpenCV's z."""
    return ray_directions(ray) * depth_m


def depth_directions(point: FloatArray | Float32Array) -> Float32Array:
    """`ray_directions` ∂x/∂Z (3, ...) of the pixels that show points (3, ...), view frame."""
    return np.ascontiguousarray(-point / point[2], np.float32)


def towards_camera(point: Float32Array) -> Float32Array:
    """Unit vectors (3, N) to the camera from points (3, N), view frame, or against directions of rays (3, N)."""
    return -point / np.sqrt(np.sum(point * point, axis=0))


def strength(light: npt.NDArray[FloatT]) -> npt.NDArray[FloatT]:
    """|s| (F, N) of light vectors s (F, 3, N)."""
    return np.sqrt(np.einsum("fcn,fcn->fn", light, light))


def value_per_strength(values: Float32Array, strength: Float32Array) -> Float32Array:
    """y/|s| (F, N) of values and strengths (F, N), as `pixel_solve_kernels` computes it: 0 of a lamp that does not
    reach the pixel."""
    return np.divide(values, strength, out=np.zeros_like(values), where=strength > np.float32(1e-9))


def project(calibration: Calibration, positions: npt.ArrayLike) -> FloatArray:
    """Pixels (K, 2) as column, row of points (K, 3) in m, view frame; lens distortion applied."""
    camera = np.asarray(positions, dtype=float).reshape(-1, 3) * np.diag(VIEW_FROM_CAMERA)[:3]
    pixels, _ = cv2.projectPoints(
        camera, np.zeros(3), np.zeros(3), np.array(calibration.camera_matrix), np.array(calibration.distortion)
    )
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def lamps(lights: Sequence[Light]) -> Float32Array:
    """Lights as an array: position in m and unit axis, view frame, (F, 6); if one has a tilt, with tilts, (F, 9)."""
    if all(light.tilt is None for light in lights):
        return np.array([[*light.position, *light.axis] for light in lights], dtype=np.float32).reshape(-1, 6)
    rows = [[*light.position, *light.axis, *(light.tilt or (0.0, 0.0, 0.0))] for light in lights]
    return np.array(rows, dtype=np.float32)


def light_vectors(point: Float32Array, lamp: Float32Array, calibration: Calibration) -> Float32Array:
    """Light vectors s (F, 3, N), view frame, at points (3, N) in m from lamps (F, 6) or (F, 9)."""
    out = np.empty((len(lamp), 3, point.shape[1]), dtype=np.float32)
    table = lobe_table(calibration.lobe)
    _light_vectors(np.ascontiguousarray(point), lamp, calibration.reference_m**2, calibration.lobe_exponent, table, out)
    return out


def lobe_spline(knots_rad: Sequence[float], angles_rad: FloatArray) -> FloatArray:
    """Cardinal functions (N, K) of a lobe's cubic spline at angles (N,): flat on the axis, not-a-knot at the end."""
    flat = np.zeros(len(knots_rad))
    end = "not-a-knot" if len(knots_rad) > 3 else (2, flat)
    spline = CubicSpline(np.array(knots_rad), np.eye(len(knots_rad)), bc_type=((1, flat), end))
    return np.asarray(spline(np.clip(angles_rad, 0.0, knots_rad[-1])), dtype=np.float64)


def lobe_table(lobe: LampLobe | None) -> Float32Array:
    """Factors (K,) of a lobe on its cosᵘ, at cosines equally spaced from 0 to 1; two ones without a lobe."""
    if lobe is None:
        return np.ones(2, dtype=np.float32)
    return _factor_table(lobe.knots_rad, lobe.factors)


@lru_cache(16)
def _factor_table(knots_rad: tuple[float, ...], factors: tuple[float, ...]) -> Float32Array:
    angles = np.arccos(np.linspace(0, 1, LOBE_SAMPLES))
    return np.exp(lobe_spline(knots_rad, angles) @ np.log(factors)).astype(np.float32)


def facing(normal_map: NormalMap, calibration: Calibration) -> BoolArray:
    """The solved pixels (H, W) inside the silhouette with normals within `GRADED_SLANT_DEG` of the viewing ray.

    Errors are averaged over them. The rim beyond is seen edge-on by few pixels, whose large σ no light lowers.
    """
    ray = rays(calibration, slice(0, calibration.height), slice(0, calibration.width))
    return normal_map.mask & inside(normal_map.silhouette) & within_graded_slant(normal_map.normals, ray)


def inside(silhouette: BoolArray) -> BoolArray:
    """The object's pixels (H, W) without those on the silhouette's border, which also show the table."""
    return cv2.erode(silhouette.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0


def bounding_box(mask: BoolArray) -> tuple[slice, slice]:
    """Bounding box of a mask as rows and columns; an empty mask's is its first pixel."""
    indices = [np.flatnonzero(np.any(mask, axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(int(one[0]), int(one[-1]) + 1) if len(one) else slice(0, 1) for one in indices)
    return rows, columns


def within_graded_slant(normals: Float32Array, ray: Float32Array) -> BoolArray:
    """Which normals (H, W, 3), view frame, lie within `GRADED_SLANT_DEG` of their viewing rays (2, H, W)."""
    out = np.empty(ray.shape[1:], np.bool_)
    for row, one in enumerate(normals):  # row by row, because all directions need much memory
        along = ray_directions(ray[:, row])
        cosine = -np.einsum("wc,cw->w", one, along) / np.sqrt(np.einsum("cw,cw->w", along, along))
        out[row] = cosine > np.cos(np.radians(GRADED_SLANT_DEG))
    return out


def mean_sigma_deg(normal_map: NormalMap, calibration: Calibration, region: BoolArray | None = None) -> float:
    """Mean σ in degrees as `facing_sigma_deg` gives it. Raises RigError normals.infeasible when no pixel has one."""
    return float(np.mean(facing_sigma_deg(normal_map, calibration, region), dtype=np.float64))


def facing_sigma_deg(normal_map: NormalMap, calibration: Calibration, region: BoolArray | None = None) -> Float32Array:
    """σ in degrees (K,) of the facing pixels, of `region` (H, W) where one is given.

    Raises RigError normals.infeasible when there are none.
    """
    counted = facing(normal_map, calibration)
    counted = counted if region is None else counted & region
    sigma = normal_map.sigma_deg[counted]
    sigma = sigma[np.isfinite(sigma)]
    if not len(sigma):
        where = "of the object" if region is None else "of the region of interest"
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, f"no pixel {where} has a normal: draw the region on the object")
    return sigma


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float64, float64, float32[::1], float32[:,:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def _light_vectors(
    point: Float32Array, lamp: Float32Array, reference_squared: float, lobe: float, table: Float32Array,
    out: Float32Array,
) -> None:  # fmt: skip
    scale = np.float32(reference_squared)
    exponent = np.float32(lobe)
    last, shaped, tilted = len(table) - 1, len(table) > 2, lamp.shape[1] > 6
    for n in numba.prange(point.shape[1]):
        for f in range(lamp.shape[0]):
            dx = lamp[f, 0] - point[0, n]
            dy = lamp[f, 1] - point[1, n]
            dz = lamp[f, 2] - point[2, n]
            inverse = np.float32(1.0) / np.sqrt(dx * dx + dy * dy + dz * dz)
            cosine = -(dx * lamp[f, 3] + dy * lamp[f, 4] + dz * lamp[f, 5]) * inverse
            factor = scale * max(cosine, np.float32(0.0)) ** exponent * inverse * inverse * inverse
            if shaped:
                at = min(max(cosine, np.float32(0.0)), np.float32(1.0)) * np.float32(last)
                below = min(int(at), last - 1)
                factor *= table[below] + (at - np.float32(below)) * (table[below + 1] - table[below])
            if tilted:
                factor *= np.float32(1.0) - (dx * lamp[f, 6] + dy * lamp[f, 7] + dz * lamp[f, 8]) * inverse
            out[f, 0, n] = factor * dx
            out[f, 1, n] = factor * dy
            out[f, 2, n] = factor * dz


@numba.njit(
    "void(float64[:,::1], float64[::1], int64, int64, float32[:,:,::1])", cache=True, parallel=True, error_model="numpy"
)
def _undistorted_rays(matrix: FloatArray, distortion: FloatArray, top: int, left: int, out: Float32Array) -> None:
    """Inverts the lens distortion k1, k2, p1, p2, k3 by fixed-point iteration, for the pixels of a window: as OpenCV's
    `undistortPoints` with a criterion, but on all cores and without its arrays in double precision."""
    k1, k2, p1, p2, k3 = distortion
    for i in numba.prange(out.shape[1]):
        for j in range(out.shape[2]):
            x0, y0 = (left + j - matrix[0, 2]) / matrix[0, 0], (top + i - matrix[1, 2]) / matrix[1, 1]
            x, y = x0, y0
            for _ in range(UNDISTORTION_ROUNDS):
                square = x * x + y * y
                inverse = 1 / (1 + ((k3 * square + k2) * square + k1) * square)
                if inverse < 0:
                    x, y = x0, y0
                    break
                aside = 2 * p1 * x * y + p2 * (square + 2 * x * x)
                below = p1 * (square + 2 * y * y) + 2 * p2 * x * y
                dx, dy = (x0 - aside) * inverse - x, (y0 - below) * inverse - y
                x, y = x + dx, y + dy
                if abs(dx) + abs(dy) < UNDISTORTION_STEP:
                    break
            out[0, i, j], out[1, i, j] = x, y


KERNELS = (_light_vectors, _undistorted_rays)
