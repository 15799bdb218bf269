"""Variance components of each pixel's normal: the posterior variance, and errors of the model that it leaves out.

The posterior variance σ₀² falls with every image. Errors that images share do not: unpredicted light from other
surfaces, or a pixel that mixes two surfaces. Two observations show them: how badly the pixel's own images fit, and how
much the normal changes from pixel to pixel:

    σ² = 1 / (1/v + 1/V²),
    v = σ₀² + χ² (B m (ε + ε̄) σ₀² + M² max(Δ² − Δ₀², 0) + M² max(λ² − 5/16 σ₀², 0)) + ω (90° − ω)/2 + E² [unchecked]

V = 49° is 1 σ of a normal on which no image has information (`photometry.bounded_variance`). Without it, pixels in
cavities that are hardly lit and fit badly have σ up to 480°, and 2–9 % of the pixels make up half of the mean σ.

χ² = (q + 1) / (f + 1) is the misfit of the pixel's own images: q is the sum of the squared whitened residuals, f their
degrees of freedom (lights − 3), and the ones are a prior of one degree of freedom. The other components say where the
model may be wrong, and χ² whether it is at this pixel (decision 101).

ε = max(χ₅² − s, 0) is the misfit beyond the stated noise, where χ₅² is q over f, both pooled over 5 × 5 pixels. s is
the part of χ₅² that sensor and calibration explain: the mean share of the stated in the estimated noise, which has
absorbed part of the model's errors. Images share the excess, so it does not average out: it is multiplied by the number
m of lights, with which σ₀² falls. ε̄ is its trimmed mean over all pixels that face the camera, without the 8 % that fit
worst (`min_pixel_share`). A model that is wrong elsewhere on the object is wrong here too, even if a few residuals
happen to be small (decision 86); misfit at creases and shadow borders alone does not count for the whole object
(decision 88).

Δ is the crease at the pixel: half of the change of the normal from one neighbour to the opposite one, less the changes
on either side of them, over both directions. Curvature continues beyond the neighbours and cancels. A Lambertian pixel
that mixes two surfaces fits its images as well as any other; its normal is a mean of theirs, and only neighbours show
that it is on neither. A crease of angle 2Δ anywhere in a pixel leaves an rms of 2Δ/√12 there, and less in the next one.

λ is the detail at the pixel: half of the angle between its normal and the mean of its four neighbours'. Noise alone
makes λ² = 5/16 σ₀². Light that spreads below the surface, or a defocused lens, smooths detail without a trace in the
residuals, and a pixel is a mean of all detail below its size. Errors follow λ in both cases, and no less where sharp
shadow edges exclude blur (decision 75). In sharpened images all detail is extrapolated, so M of λ is 1. Measured on 25
captures of surfaces found translucent (design seeds 205, 215, 225 and 235, 8 and 20 lights by two rings): this raises
the mean log-likelihood of errors by 0.022, P(e < 2σ) from 0.91 to 0.93, and P(e < σ) from 0.65 to 0.69.

ω is the line at the pixel: the deviation of its normal, over one or two pixels, from the mean of those on both sides,
if these agree, as at the walls of a terrace or a groove narrower than that. If such a wall, inclined by A, takes the
share f of a pixel, images show fA = ω, but the surface has 0 or A. The mean square of the error is then ω (A − ω), and
ω (90° − ω)/2 over all possible A. λ and Δ are small there (decision 76).

E is 1 σ of an unchecked normal (`photometry.SharedSettings.unchecked_sigma_deg`). It counts if fewer than four lights
reach the pixel or something remains wrong with the whole capture, half of it for metal
(`photometry.capture_sigma_deg`).

Left out, by scratch fits on design seeds (November 2026): the weight of a depth discontinuity, which adds 0.003 to the
mean log-likelihood beside M; the rotation by the integrability projection and predicted indirect light, which add up to
0.05 on captures that they are fitted to and 0.01–0.02 on others, without a change of rms e/σ; λ against the mean of all
eight neighbours, of 24, or of a Gaussian surrounding, which is less informative, and the sum of squared second
differences along rows and columns, which is nearly as informative. A sandwich estimate, the albedo's local contrast,
slant and gloss were tried only before M was found.

The constants are near those that make the errors of design captures likeliest under Rayleigh's law with a heavy tail
(bivariate t, 20 degrees of freedom), with a factor of 1 for σ₀² itself. B and M are from 66 captures of seeds 557–562
under 6, 8 and 20 lights: a little larger than the likeliest, 0.07 and 0.3, so that P(e < 2σ) is 0.94 there and above
0.9 in each family (decision 101). E, 8.9° for few lights, is from 117 captures of seeds 65, 70, 71, 73 and 75 under
6–20 lights. `python -m tests.unseen fit-sigma` fits such captures, and prints how much less likely the errors are
without each component. The constants depend on the assumed tail (`tests.unseen.sigma_fit`). `tests/unseen/reports.md`
has results of captures that they were not fitted to. B and E belong to `photometry`, because forecasts of plans use
them as well.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class ErrorVarianceSettings:
    """Tuned numbers of σ's components."""

    structure_share: float = tuned(0.36, "share")
    """M: 1 σ of the normal as a share of Δ, half of the angle of a crease, and of λ, half of the angle to the mean of
    the neighbours' normals, where the pixel's own images fit as the noise predicts. Measured on the captures of
    `misfit_factor` (B = 0.1): the mean log-likelihood of errors is lower by 0.010 with 0.18, higher by 0.004 with 0.3
    and lower by 0.076 with 0.72; P(e < 2σ) is 0.930, 0.938 and 0.951, and 0.941 with this value. Under 20 lights alone
    0.19 is likeliest (decision 101)."""
    min_crease_deg: float = tuned(12.0, "deg")
    """Δ₀, degrees, above which Δ counts; smaller creases are noise, or too small to tell. It is from a fit to 190
    captures of design seeds 40–43 and 60–63 (two rings of 6, 8 and 20 lights, November 2026), which compares 8, 12, 16,
    20 and 24° by the likelihood of errors (`python -m tests.unseen fit-sigma`)."""


SETTINGS = ErrorVarianceSettings()

POSTERIOR, MISFIT, CREASE, DETAIL, LINE = range(5)
"""Indices of some of the `components`."""

NOISE_DETAIL = 5 / 16
"""λ² by noise alone over σ₀²: a quarter of the sum of the variances of a normal and of the mean of four others."""

NOISE_LINE = 3 / 2
"""ω² by noise alone over σ₀²: the sum of the variances of a normal and of the mean of two others."""

LINES_PX = ((1, 1), (1, 2), (2, 1))
"""Distances, pixels, to either side: of a line of one pixel, and of the first and the second pixel of a line of two."""

FOUR_NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32)

STRIP_ROWS, NEIGHBOUR_ROWS = 256, 3
"""Rows that are evaluated at once, and rows beyond them that are read with them."""

POOLED_PX = 5
"""Side, px, of the square over which misfit is pooled: of 3, 5, 7 and 15 errors are likeliest with 5 (decision 86)."""


@dataclass(frozen=True)
class ErrorVariance:
    """σ (H, W) in degrees over both tangential directions, NaN where there is no normal, and figures of the pixels that
    face the camera.

    These are the trimmed mean ε̄; `misfit`, 1 + the value of χ² (ε + ε̄) that would raise σ of all pixels as much as
    theirs do in the mean; and `structure_deg`, the mean part of σ by creases, detail and lines. Forecasts of further
    lights use the last two.
    """

    sigma_deg: Float32Array
    typical_excess: float
    misfit: float
    structure_deg: float


def evaluate(
    posterior_deg: Float32Array, residual: Float32Array, lights: np.ndarray, stated_share: Float32Array,
    normals: Float32Array, facing: BoolArray, *, capture_deg: float, sharpened: bool = False,
) -> ErrorVariance:  # fmt: skip
    """Sums the weighted variance `components`, whose arguments the maps are.

    `facing` (H, W) are the pixels that face the camera; if there are none, all pixels are used. `capture_deg` is E of
    the whole capture. `sharpened`: its images were sharpened, because light spreads below the surface.
    """
    known = np.isfinite(posterior_deg)
    facing = facing & known if np.any(facing & known) else known
    of_facing = residual[facing], lights[facing], stated_share[facing]
    typical = typical_excess(*of_facing)
    out, weight = np.full_like(posterior_deg, np.nan), weights(sharpened=sharpened)
    structure, raised = 0.0, 0.0
    for start in range(0, len(out), STRIP_ROWS):
        stop = min(start + STRIP_ROWS, len(out))
        first, last = max(start - NEIGHBOUR_ROWS, 0), min(stop + NEIGHBOUR_ROWS, len(out))
        maps = (posterior_deg, residual, lights, stated_share, normals)
        strip = (one[first:last] for one in maps)
        parts = components(*strip, typical=typical)[:, start - first : stop - first]
        by_images = np.asarray(np.tensordot(weight, parts, 1) + capture_deg**2, np.float64)
        variance = photometry.bounded_variance(by_images)
        out[start:stop] = np.where(known[start:stop], np.sqrt(variance), np.nan)
        counted = facing[start:stop]
        by_structure = np.sqrt(np.tensordot(weight[CREASE : LINE + 1], parts[CREASE : LINE + 1], 1))
        by_misfit = np.sqrt(1 + weight[MISFIT] * parts[MISFIT] / np.maximum(parts[POSTERIOR], np.float32(1e-12)))
        structure += float(np.sum(by_structure[counted], dtype=np.float64))
        raised += float(np.sum(by_misfit[counted], dtype=np.float64))
    count = np.count_nonzero(facing)
    if count == 0:
        return ErrorVariance(out, typical, 1.0, 0.0)
    by_lights = weight[MISFIT] * np.mean(lights[facing], dtype=np.float64)
    return ErrorVariance(out, typical, 1 + float(((raised / count) ** 2 - 1) / by_lights), structure / count)


def weights(*, sharpened: bool = False) -> Float32Array:
    """Returns the weights 1, B, M², M², 1/2 and E² of `components`; for sharpened images that of detail is 1."""
    shared, structure = photometry.SETTINGS, SETTINGS.structure_share**2
    detail = 1.0 if sharpened else structure
    return np.array([1.0, shared.misfit_factor, structure, detail, 0.5, shared.unchecked_sigma_deg**2], np.float32)


def components(
    posterior_deg: Float32Array, residual: Float32Array, lights: np.ndarray, stated_share: Float32Array,
    normals: Float32Array, *, typical: float,
) -> Float32Array:  # fmt: skip
    """Returns the components (6, H, W) that 1, B, M², M², 1/2 and E² multiply: deg², the last one 0 or 1.

    `posterior_deg` (H, W) is σ after integrability projection and regression, NaN where there is no normal. `residual`
    is the rms of whitened residuals, `lights` the number of a pixel's measurements, `stated_share` the share of the
    stated noise in their variance, `normals` (H, W, 3) are the final ones, and `typical` is the excess ε̄.
    """
    known = np.isfinite(posterior_deg)
    base = np.where(known, posterior_deg, 0) ** 2
    squares, freedom = _squares(residual, np.where(known, lights, 0))
    unexplained = np.subtract(squares, stated_share * freedom, dtype=np.float32)
    local = np.maximum(_pooled(unexplained) / np.maximum(_pooled(freedom), 1), 0)
    own = _shrunk(squares, freedom)
    crease = np.maximum(crease_deg2(normals, known) - SETTINGS.min_crease_deg**2, 0)
    detail = np.maximum(detail_deg2(normals, known) - NOISE_DETAIL * base, 0)
    line = line_deg(normals, known, base)
    few = lights < photometry.OVERDETERMINED
    misfit = lights * (local + np.float32(typical)) * base
    parts = [base, own * misfit, own * crease, own * detail, line * np.maximum(90 - line, 0), few]
    return np.stack(parts).astype(np.float32)


def own_misfit(residual: Float32Array, lights: np.ndarray) -> Float32Array:
    """Returns each pixel's own χ² (h, w), shrunk towards 1 by one degree of freedom, from maps as in `components`."""
    return _shrunk(*_squares(residual, lights))


def _shrunk(squares: Float32Array, freedom: Float32Array) -> Float32Array:
    """Returns χ² of a sum of squares with its degrees of freedom, with a prior of 1 and one degree of freedom."""
    return (squares + 1) / (freedom + 1)


def typical_excess(residual: Float32Array, lights: np.ndarray, stated_share: Float32Array) -> float:
    """Returns ε̄ of pixels with values as in `components`: ε of all together without the `min_pixel_share` of them whose
    own ε is largest (trimmed mean); 0 if no pixel has residuals."""
    squares, freedom = _squares(residual, lights)
    redundant = freedom > 0
    if not np.any(redundant):
        return 0.0
    each = squares[redundant] / freedom[redundant] - stated_share[redundant]
    kept = each <= np.quantile(each, 1 - photometry.SETTINGS.min_pixel_share)
    weight = freedom[redundant][kept]
    return max(float(np.sum(weight * each[kept], dtype=np.float64) / np.sum(weight, dtype=np.float64)), 0.0)


def _squares(residual: Float32Array, lights: np.ndarray) -> tuple[Float32Array, Float32Array]:
    """Returns each pixel's sum of squared whitened residuals and degrees of freedom (h, w); 0 with fewer than four
    lights. Residuals are cut at `significant_deviations`, because robust weights have rejected larger ones."""
    most = photometry.SETTINGS.significant_deviations**2
    freedom = np.where(lights >= photometry.OVERDETERMINED, lights.astype(np.float32) - photometry.PIXEL_UNKNOWNS, 0)
    squares = np.where(freedom > 0, np.minimum(residual**2, most) * lights, 0)
    return squares.astype(np.float32), freedom.astype(np.float32)


def crease_deg2(normals: Float32Array, known: BoolArray) -> Float32Array:
    """Returns Δ² (H, W), deg², of normals (H, W, 3), summed over rows and columns; 0 where a neighbour is unknown."""
    out = np.zeros(known.shape, np.float32)
    for axis in (0, 1):
        n, k = np.swapaxes(normals, 0, axis), np.swapaxes(known, 0, axis)
        step = _length(n[1:] - n[:-1]) * (k[1:] & k[:-1])
        beyond = np.zeros((2, len(n), *step.shape[1:]), np.float32)
        beyond[0, 2:], beyond[1, :-2] = step[:-1], step[1:]
        across = _length(n[2:] - n[:-2]) * (k[2:] & k[1:-1] & k[:-2])
        sides = beyond[0, 1:-1] + beyond[1, 1:-1]
        np.swapaxes(out, 0, axis)[1:-1] += (np.maximum(across - sides, 0) / 2) ** 2
    return np.float32(np.degrees(1) ** 2) * out


def detail_deg2(normals: Float32Array, known: BoolArray) -> Float32Array:
    """Returns λ² (H, W), deg², of normals (H, W, 3): squared half angle to the mean of the four neighbours' that are
    known, else 0."""
    around = cv2.filter2D(normals * known[..., None], -1, FOUR_NEIGHBOURS, borderType=cv2.BORDER_CONSTANT)
    length = _length(around)
    chord = _length(normals - around / np.maximum(length, np.float32(1e-6))[..., None])
    half = np.degrees(np.arcsin(np.minimum(chord / 2, 1)))
    return np.where(known & (length > 0), half**2, 0).astype(np.float32)


def line_deg(normals: Float32Array, known: BoolArray, variance_deg2: Float32Array) -> Float32Array:
    """Returns ω (H, W), degrees, of normals (H, W, 3) of variance σ₀² (H, W), the largest over rows, columns and
    `LINES_PX`; 0 where a side is unknown."""
    most = np.zeros(known.shape, np.float32)
    for axis in (0, 1):
        n, k = np.swapaxes(normals, 0, axis), np.swapaxes(known, 0, axis)
        noise, out = np.swapaxes(variance_deg2, 0, axis), np.swapaxes(most, 0, axis)
        cosine = {apart: _dot(n[apart:], n[:-apart]) for apart in (1, 2, 3)}
        step = np.zeros((len(n) + 1, *n.shape[1:2]), np.float32)  # chord² from each normal's predecessor
        step[1:-1] = np.where(k[1:] & k[:-1], 2 - 2 * cosine[1], 0)
        for before, after in LINES_PX:
            last = before + after
            count = max(len(n) - last, 0)
            here = slice(before, before + count)
            sides = 2 + 2 * cosine[last]  # squared length of their sum
            towards = cosine[before][:count] + cosine[after][here]
            deviation = 2 - 2 * towards / np.sqrt(np.maximum(sides, np.float32(1e-6)))
            beyond = step[:count] + step[last + 1 :]
            chance = np.float32(NOISE_LINE * np.radians(1) ** 2) * noise[here] + beyond
            square = deviation - (4 - sides) - np.float32(photometry.SETTINGS.outlying_deviations**2) * chance
            square *= k[here] & k[:count] & k[last:]
            np.maximum(out[here], square, out=out[here])
    return np.float32(np.degrees(1)) * np.sqrt(most)


def _dot(one: np.ndarray, other: np.ndarray) -> Float32Array:
    """Returns scalar products (...,) of vectors (..., 3), in a quarter of the time of `numpy.einsum`."""
    return np.asarray(one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1] + one[..., 2] * other[..., 2])


def _length(vectors: np.ndarray) -> Float32Array:
    """Returns lengths (...,) of vectors (..., 3), in a sixth of the time of `numpy.linalg.norm`."""
    return np.asarray(np.sqrt(_dot(vectors, vectors)), np.float32)


def _pooled(values: Float32Array) -> Float32Array:
    """Returns the sum (h, w) over the square of POOLED_PX round each pixel."""
    size = (POOLED_PX, POOLED_PX)
    return np.asarray(cv2.boxFilter(values.astype(np.float32), -1, size, normalize=False), np.float32)
