"""Glossy objects under many distant lights: gloss from each pixel, the matt part's form from the whole object.

How matt light falls off with the angle of incidence and how the normal is tilted look alike in one pixel, but every
pixel of an object tells of the same fall-off at another normal. So the form (κ, ω, γ of `reflectance.basis`) is the one
at which a sample of pixels, each with its own best normal and strengths, is explained best. Lambert's law wins unless
another explains distinctly more: a wrong law costs several degrees, a form that is a little off a few tenths.
"""

from dataclasses import dataclass, fields

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.normals.distant import reflectance_kernels, robust_regression

SHADOW = 0.15
"""Of a pixel's bright values (80th percentile): what is darker is left out, being lit by other surfaces if at all."""

SOFTENING = 0.2
"""Weights are 1/(y + this), y in units of the pixel's median: between constant noise and noise in proportion."""

LAMBERT = np.array([0.0, 0.0, 1.0])
FORM_SIGMA = np.array([0.08, 0.032, 0.028])
"""1 σ of the form: what is left where no form of the family fits a material, found on materials outside of it."""

STEP = 1e-3
"""Change of normal and form for difference quotients."""

CHUNK = 2048
"""Pixels whose derivatives are held at once."""

COARSE = tuple((kappa, omega, 1.0) for kappa in (0.0, 0.5, 1.0) for omega in (0.0, 0.25, 0.5))
LOWEST = np.array([-0.6, -0.2, 0.6])
HIGHEST = np.array([1.2, 0.9, 1.6])
FIRST_STEP = np.array([0.25, 0.12, 0.12])
LAST_STEP = 0.03
CAUCHY_SCALE = 2.5
LEAST_SPREAD = 0.003
RING = 0.12
"""Radius, rad, of the ring of starts round the first normal."""

REACHES = (1, 2)
"""Pixels between neighbours that lend one another their normals as starts."""

APART_RAD = 0.1
"""Between two normals that count as different starts."""


@dataclass(frozen=True)
class Fits:
    """What was found for N pixels."""

    normals: Float32Array  # (N, 3)
    strengths: Float32Array  # (N, K) in units of brightness
    variance: Float32Array  # (N,) rad², both tangential directions
    spread: Float32Array  # (N,) of weighted residuals, in units of the pixel's median
    loss: Float32Array  # (N,)

    def subset(self, chosen: np.ndarray | slice) -> "Fits":
        """Some of the pixels, by their number."""
        return Fits(**{one.name: getattr(self, one.name)[chosen] for one in fields(self)})


def light_table(directions: FloatArray) -> FloatArray:
    """Unit light directions and half vectors to a camera along z, (6, F)."""
    half = directions + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return np.ascontiguousarray(np.concatenate([directions, half], axis=1).T)


def start(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> Float32Array:
    """First normals (N, 3): least squares over the middle ranks."""
    found, figures = np.empty((len(values), 3), np.float32), np.empty((len(values), 2), np.float32)
    robust_regression.solve(
        values, (~clipped).astype(np.uint8), directions, np.empty((0, 3), np.int64), np.empty((0, 3, 3)),
        np.array([*robust_regression.MIDDLE, 0.0, 0.0]), found, figures,
    )  # fmt: skip
    found[:, 2] = np.maximum(found[:, 2], 0.03 * np.linalg.norm(found, axis=1) + 1e-9)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def fit(
    values: Float32Array,
    clipped: BoolArray,
    table: FloatArray,
    form: FloatArray,
    first: Float32Array,
    *,
    ring: float = RING,
    iterations: int = 12,
) -> Fits:
    """Fits pixels, brightness (N, F), from normals (N, 3) with a given form of the matt part."""
    typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9)
    y = np.ascontiguousarray(values / typical, dtype=np.float32)
    trust = np.where(trusted(y, clipped), 1.0 / (np.maximum(y, 0) + SOFTENING), 0.0).astype(np.float32)
    y[clipped] = 0.0
    count = len(values)
    normals = np.empty((count, 3), np.float32)
    strengths = np.empty((count, reflectance_kernels.STRENGTHS), np.float32)
    figures = np.empty((count, 3), np.float32)
    reflectance_kernels.fit(
        y, trust, table, form, reflectance_kernels.WIDTHS, np.array([CAUCHY_SCALE, LEAST_SPREAD, iterations, ring]),
        np.ascontiguousarray(first, dtype=np.float32), normals, strengths, figures,
    )  # fmt: skip
    return Fits(normals, strengths * typical.astype(np.float32), figures[:, 2], figures[:, 1], figures[:, 0])


def from_neighbours(
    fits: Fits, values: Float32Array, clipped: BoolArray, table: FloatArray, form: FloatArray, place: np.ndarray,
    width: int,
) -> Fits:  # fmt: skip
    """The fits of pixels, brightness (N, F), or better ones that start from the normal of a pixel nearby.

    `place` (N,) are the pixels' numbers in rows of `width`. A pixel in shadow under a third of the lights starts badly
    by itself, tens of degrees off, while one beside it may have found its way.
    """
    for reach in REACHES:
        beside = _beside(place, width, reach)
        loss = np.where(beside >= 0, fits.loss[beside], np.inf)
        best = np.take_along_axis(beside, np.argmin(loss, axis=0)[None], axis=0)[0]
        alike = np.einsum("nc,nc->n", fits.normals[best], fits.normals) > np.cos(APART_RAD)
        tried = np.flatnonzero((np.min(loss, axis=0) < fits.loss) & ~alike)
        if len(tried) == 0:
            continue
        again = fit(values[tried], clipped[tried], table, form, fits.normals[best[tried]], ring=0.0)
        better = again.loss < fits.loss[tried]
        parts = {one.name: getattr(fits, one.name).copy() for one in fields(Fits)}
        for name, part in parts.items():
            part[tried[better]] = getattr(again, name)[better]
        fits = Fits(**parts)
    return fits


def matt_form(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> FloatArray:
    """The form (3,) of the matt part that explains a sample of pixels (N, F) best."""
    values, clipped = np.ascontiguousarray(values), np.ascontiguousarray(clipped)
    table, first = light_table(directions), start(values, clipped, directions)
    known: dict[tuple[float, ...], tuple[float, Float32Array]] = {}

    def loss(form: FloatArray, begin: Float32Array, ring: float) -> tuple[float, Float32Array]:
        key = tuple(np.round(form, 4).tolist())
        if key not in known:
            fits = fit(values, clipped, table, form, begin, ring=ring, iterations=6)
            known[key] = float(np.mean(np.log(fits.loss + 1e-4))), fits.normals
        return known[key]

    least, form, begin = np.inf, LAMBERT, first
    for candidate in COARSE:
        here, normals = loss(np.array(candidate), first, 1.25 * RING)
        if here < least:
            least, form, begin = here, np.array(candidate), normals
    step = FIRST_STEP
    while step[0] > LAST_STEP:
        moved = False
        for axis in range(len(form)):
            for sign in (1.0, -1.0):
                trial = form.copy()
                trial[axis] += sign * step[axis]
                trial = np.clip(trial, LOWEST, HIGHEST)
                here, normals = loss(trial, begin, 0.0)
                if here < least - 1e-3:
                    least, form, begin, moved = here, trial, normals, True
                    break
        if not moved:
            step = step / 2
    return form


def roughness(normals: Float32Array, place: np.ndarray, width: int) -> Float32Array:
    """How far normals (N, 3) lie, rad, from the mean of the two on either side, beyond what these are wrong by.

    Curvature cancels in that mean; noise, edges and pixels that went astray do not. Of rows and columns the larger
    counts, zero where a pixel has no such neighbours; `place` and `width` as for `from_neighbours`.
    """
    right, left, below, above = _beside(place, width, 1)
    out = np.zeros(len(normals), np.float32)
    for one, other in ((left, right), (above, below)):
        both = (one >= 0) & (other >= 0)
        apart = np.linalg.norm(normals - (normals[one] + normals[other]) / 2, axis=1)
        out = np.where(both, np.maximum(out, apart), out)
    return (np.sqrt(2 / 3) * out).astype(np.float32)


def _beside(place: np.ndarray, width: int, reach: int) -> np.ndarray:
    """The numbers (4, N) of the pixels to the right, left, below and above, or −1."""
    row, column = np.divmod(place, width)
    around = np.full((int(row.max(initial=0)) + 1 + 2 * reach, width + 2 * reach), -1)
    around[row + reach, column + reach] = np.arange(len(place))
    steps = ((0, reach), (0, -reach), (reach, 0), (-reach, 0))
    return np.stack([around[row + reach + down, column + reach + right] for down, right in steps])


def form_variance(
    fits: Fits, values: Float32Array, clipped: BoolArray, table: FloatArray, form: FloatArray
) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, if the matt part's form is off by FORM_SIGMA.

    No pixel's residuals show this error: bending the fall-off and tilting the normal look alike. To first order the
    normal turns by (JᵀWJ)⁻¹JᵀW ∂m/∂form, J and ∂m/∂form with the strengths projected out.
    """
    parts = [slice(start, start + CHUNK) for start in range(0, len(values), CHUNK)]
    found = [_form_variance(fits.subset(part), values[part], clipped[part], table, form) for part in parts]
    return np.concatenate(found) if found else np.empty(0, np.float32)


def _form_variance(
    fits: Fits, values: Float32Array, clipped: BoolArray, table: FloatArray, form: FloatArray
) -> Float32Array:
    typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9).astype(np.float32)
    y, strengths = values / typical, fits.strengths / typical
    trust = np.where(trusted(y, clipped), 1.0 / (np.maximum(y, 0) + SOFTENING), 0.0)
    lobes = strengths[:, :, None] * _every_basis(fits.normals, table, form)  # (N, K, F); zero where not used
    predicted = lobes.sum(axis=1)
    squared = (CAUCHY_SCALE * np.maximum(fits.spread, LEAST_SPREAD)[:, None]) ** 2
    weight = trust / (1 + (y - predicted) ** 2 * trust / squared)

    def moved(change: FloatArray) -> FloatArray:
        normals = fits.normals + STEP * change
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return (np.einsum("nk,nkf->nf", strengths, _every_basis(normals, table, form)) - predicted) / STEP

    aside = np.where(np.abs(fits.normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(fits.normals, aside)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    rows = [moved(across), moved(np.cross(fits.normals, across))]
    for one in np.eye(reflectance_kernels.FORM):
        bent = matt(fits.normals, table, form + STEP * one) * strengths[:, :1]
        rows.append((bent - lobes[:, 0]) / STEP)
    root = np.sqrt(weight)
    columns = (np.stack(rows, axis=1) * root[:, None]).astype(np.float64)  # (N, 2 + FORM, F)
    own = (lobes * root[:, None]).astype(np.float64)
    inner = own @ own.transpose(0, 2, 1)
    inner += (1e-9 + 1e-9 * np.trace(inner, axis1=1, axis2=2))[:, None, None] * np.eye(len(inner[0]))
    columns -= (columns @ own.transpose(0, 2, 1)) @ np.linalg.solve(inner, own)
    tilt, bend = columns[:, :2], columns[:, 2:]
    matrix = tilt @ tilt.transpose(0, 2, 1) + 1e-9 * np.eye(2)
    turned = np.linalg.solve(matrix, tilt @ bend.transpose(0, 2, 1)) * FORM_SIGMA
    return np.sum(turned**2, axis=(1, 2)).astype(np.float32)


def trusted(values: Float32Array, clipped: BoolArray) -> BoolArray:
    """Which measurements (N, F) are used: neither clipped nor far darker than the pixel's bright ones."""
    return (values >= np.quantile(values, 0.8, axis=1, keepdims=True) * SHADOW) & ~clipped


def matt(normals: np.ndarray, table: FloatArray, form: FloatArray) -> Float32Array:
    """Brightness (N, F) of a matt surface of strength 1 with these normals (N, 3)."""
    return _every_basis(normals, table, form)[:, 0]


def brightness(fits: Fits, table: FloatArray, form: FloatArray) -> FloatArray:
    """Brightness (N, F) that the fits predict under lights (6, F)."""
    return np.einsum("nk,nkf->nf", fits.strengths, _every_basis(fits.normals, table, form))


def _every_basis(normals: np.ndarray, table: FloatArray, form: FloatArray) -> Float32Array:
    out = np.empty((len(normals), reflectance_kernels.STRENGTHS, table.shape[1]), np.float32)
    reflectance_kernels.many(
        np.ascontiguousarray(normals, dtype=np.float64), table, form, reflectance_kernels.WIDTHS, out
    )
    return out
