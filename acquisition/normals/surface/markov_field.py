"""Markov random field on uncertain pixels: iterated conditional modes (Besag 1986) of albedo × normal given neighbours.

If only one or two lamps reach a pixel, or if it mixes surfaces, its images determine g = albedo × normal along some
directions; along the others there is only a weak prior. There the neighbours are more informative. Each uncertain pixel
is moved to the mode of its conditional distribution. This combines the normal equations of g by its images, a weak
prior on its present g, and for each of four neighbours two robust terms (Cauchy), on the change of the normal and of
the logarithm of albedo. The usual size of these changes is measured where normals are certain. A smooth object of one
paint thus gives a narrow prior, a carved or painted one almost none.

Pixels at an edge mix its two sides, and a region that few lamps reach may be wide, so distant neighbours are used
first, then closer ones. Certain pixels do not change.

The σ of an uncertain pixel falls: the precision by the field is added to that by the pixel's own images. Conditional
variances take the errors of neighbours for independent, but most of them are shared, so σ by the field is multiplied
by `sigma_factor` before (decision 100).

Decision 93 states what the field improves and what it does not. The neighbours' normals are not used as prior mean of
the pixel solve: this gains nothing, because beside walls and in holes the nearest ones belong to other surfaces.

Kernels compile at import, into numba's cache.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.tuned import tuned
from acquisition.normals.images import memory_mapped
from acquisition.normals.pixels import pixel_solve


@dataclass(frozen=True)
class MarkovFieldSettings:
    """Tuned numbers of the Markov random field."""

    sigma_factor: float = tuned(20.0, "1")
    """Factor by which σ by the field is larger than the root of the conditional variance, which takes the errors of
    neighbours for independent. A smaller factor lowers σ of uncertain pixels further. Measured by the mean
    log-likelihood of errors, of 12, 15, 20, 25 and 30: 20 is best on captures of design seeds 549–551 (8 and 20 lights
    by two rings together) and on others of seeds 552–554; under 6 lights 25 is better by 0.011. With 20 it is 0.045
    above that of σ by the images alone (decision 100)."""


SETTINGS = MarkovFieldSettings()

REACH, SWEEPS = 32, 5
"""The largest distance between neighbours is the window's longer side over REACH; each distance gets SWEEPS sweeps.
Measured: with half or twice either number errors change by 0.4 % at most."""

LARGEST_STEP = 0.7
"""Largest step of g as a share of its length, so that g does not change its sign."""

UNKNOWN = np.float32(1e9)
"""Variance of pixels without a normal."""

STRIP_ROWS, SAMPLED_ROWS = 256, 256
"""Rows whose equations are read at once, and approximate number of rows whose changes are measured."""


def regularise(
    normals: Float32Array, albedo: Float32Array, sigma_deg: Float32Array, known_deg: Float32Array,
    equations: Float32Array, ray: Float32Array,
) -> None:  # fmt: skip
    """Regularises unit normals (H, W, 3), view frame, and albedo and σ (H, W) of uncertain pixels by those around.

    These three change in place.

    `known_deg` (H, W) is 1 σ by the images, with edges and misfit, NaN where there is no normal; pixels above
    `unchecked_sigma_deg` are uncertain. `sigma_deg` (H, W) has what nothing has checked, too. `equations` (H, W, 9),
    from `memory_mapped.zeros`, are the normal equations of `pixel_solve.normal_equations`. If σ is larger than they
    explain, they are scaled by the square root of the variances' ratio. `ray` (2, H, W) are the pixels' rays; normals
    stay visible.
    """
    known = np.isfinite(known_deg) & (albedo > 0)
    certain = known & (known_deg <= photometry.SETTINGS.unchecked_sigma_deg)
    uncertain = np.flatnonzero(known & ~certain)
    if np.count_nonzero(certain) < photometry.SETTINGS.min_sample or not len(uncertain):
        return
    own = _of_pixels(equations, uncertain)
    least = np.float32(pixel_solve.least_prior_albedo(float(np.median(albedo[certain]))))
    _weigh(normals, albedo, known_deg, uncertain, least, photometry.SETTINGS.prior_scale, own)
    variance = np.full(known.shape, UNKNOWN, np.float32)
    largest = int(np.log2(max(*known.shape, REACH) / REACH))
    for stride in (1 << power for power in range(largest, -1, -1)):
        changes = _usual_changes(normals, albedo, certain, stride)
        if changes is None:
            continue
        np.square(np.radians(known_deg, out=variance), out=variance)
        np.copyto(variance, UNKNOWN, where=~known)
        for _ in range(SWEEPS):
            for parity in (0, 1):
                _sweep(normals, albedo, variance, uncertain, own, stride, parity, *changes, photometry.CAUCHY_SCALE**-2)
    rows, columns = np.unravel_index(uncertain, known.shape)
    by_field = SETTINGS.sigma_factor * np.degrees(np.sqrt(variance[rows, columns]))
    sigma_deg[rows, columns] = 1 / np.sqrt(1 / sigma_deg[rows, columns] ** 2 + 1 / by_field**2)
    direction = photometry.ray_directions(np.ascontiguousarray(ray[:, rows, columns]))
    visible = pixel_solve.clamp_to_visible(np.ascontiguousarray(normals[rows, columns].T), direction)
    normals[rows, columns] = visible.T


def _of_pixels(equations: Float32Array, chosen: np.ndarray) -> Float32Array:
    """Reads the equations (K, 9) of the pixels with flat numbers `chosen` (K,), sorted, strip by strip."""
    height, width = equations.shape[:2]
    out = np.empty((len(chosen), 9), np.float32)
    for start in range(0, height, STRIP_ROWS):
        stop = min(start + STRIP_ROWS, height)
        first, last = np.searchsorted(chosen, (start * width, stop * width))
        out[first:last] = equations[start:stop].reshape(-1, 9)[chosen[first:last] - start * width]
        memory_mapped.release(equations)
    return out


def _usual_changes(
    normals: Float32Array, albedo: Float32Array, certain: BoolArray, stride: int
) -> tuple[float, float] | None:
    """Returns the variances of the changes of normal, rad², and of log albedo between certain pixels at a distance
    `stride` along rows and columns; none if these are too few. 1 σ is twice the median change, because changes have
    long tails. Measured: errors are the same to 0.4 % with once and three times the median."""
    turns: list[Float32Array] = []
    shades: list[Float32Array] = []
    for axis in (0, 1):
        some = slice(None, None, max(certain.shape[1 - axis] // SAMPLED_ROWS, 1))
        n, a = (np.swapaxes(image, 0, axis)[:, some] for image in (normals, albedo))
        k = np.swapaxes(certain, 0, axis)[:, some]
        both = k[stride:] & k[:-stride]
        turns.append(np.sqrt(np.sum((n[stride:][both] - n[:-stride][both]) ** 2, axis=-1)))
        shades.append(np.abs(np.log(a[stride:][both] / a[:-stride][both])))
    turn, shade = np.concatenate(turns), np.concatenate(shades)
    if len(turn) < photometry.SETTINGS.min_sample:
        return None
    medians = (float(np.median(one)) for one in (turn, shade))
    of_normal, of_albedo = (max(2 * median, photometry.SETTINGS.flat_field_sigma) ** 2 for median in medians)
    return of_normal, of_albedo


@numba.njit(
    f"Tuple(({', '.join(['float32'] * 4)}))({', '.join(['float32'] * 12)})",
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _solved(  # noqa: PLR0913 - a numba kernel
    m0: np.float32, m1: np.float32, m2: np.float32, m3: np.float32, m4: np.float32, m5: np.float32,
    b0: np.float32, b1: np.float32, b2: np.float32, x: np.float32, y: np.float32, z: np.float32,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:  # fmt: skip
    """Solves M d = b by LDLᵀ; also returns the variance of the direction of (x, y, z) by M⁻¹, rad².

    Pivots are at least what single precision distinguishes from 0: bright highlights have 10⁷ times the prior's weight.
    """
    one, least = np.float32(1), np.float32(1e-6) * (m0 + m3 + m5)
    i0 = one / max(m0, least)
    l1, l2 = m1 * i0, m2 * i0
    i1 = one / max(m3 - l1 * m1, least)
    l3 = (m4 - l2 * m1) * i1
    i2 = one / max(m5 - l2 * m2 - l3 * (m4 - l2 * m1), least)
    u1 = b1 - l1 * b0
    d2 = (b2 - l2 * b0 - l3 * u1) * i2
    d1 = u1 * i1 - l3 * d2
    d0 = b0 * i0 - l1 * d1 - l2 * d2
    c22, c12 = i2, -l3 * i2
    c02 = (l1 * l3 - l2) * i2
    c11 = i1 - l3 * c12
    c01 = -l1 * i1 - l3 * c02
    c00 = i0 - l1 * c01 - l2 * c02
    square = x * x + y * y + z * z
    along = c00 * x * x + c11 * y * y + c22 * z * z + np.float32(2) * (c01 * x * y + c02 * x * z + c12 * y * z)
    return d0, d1, d2, max(c00 + c11 + c22 - along / square, np.float32(1e-12) * square) / square


@numba.njit(
    "void(float32[:,:,:], float32[:,:], float32[:,:], int64[::1], float32, float64, float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _weigh(
    normals: Float32Array, albedo: Float32Array, sigma_deg: Float32Array, uncertain: np.ndarray, least: np.float32,
    prior_scale: float, own: Float32Array,
) -> None:  # fmt: skip
    """Scales a pixel's own normal equations to its stated variance, and adds a prior on the present g, in place."""
    width = albedo.shape[1]
    for k in numba.prange(len(uncertain)):
        i, j = uncertain[k] // width, uncertain[k] % width
        rho, stated = albedo[i, j], np.float32(math.radians(sigma_deg[i, j]) ** 2)
        prior = np.float32(1 / (prior_scale * max(rho, least)) ** 2)
        x, y, z = rho * normals[i, j, 0], rho * normals[i, j, 1], rho * normals[i, j, 2]
        _, _, _, variance = _solved(
            own[k, 0] + prior, own[k, 1], own[k, 2], own[k, 3] + prior, own[k, 4], own[k, 5] + prior, x, y, z, x, y, z
        )
        share = np.float32(math.sqrt(min(variance / stated, np.float32(1))))
        for c in range(9):
            own[k, c] *= share
        for c in (0, 3, 5):
            own[k, c] += prior
        own[k, 6] += prior * x
        own[k, 7] += prior * y
        own[k, 8] += prior * z


@numba.njit(
    "void(float32[:,:,:], float32[:,:], float32[:,::1], int64[::1], float32[:,::1], int64, int64, float64, float64,"
    " float64)",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _sweep(  # noqa: PLR0913 - a numba kernel
    normals: Float32Array, albedo: Float32Array, variance: Float32Array, uncertain: np.ndarray, own: Float32Array,
    stride: int, parity: int, of_normal: float, of_albedo: float, inverse_cauchy2: float,
) -> None:  # fmt: skip
    """Moves each uncertain pixel of a parity by a Gauss–Newton step towards its conditional mode; updates its variance.

    A neighbour is weighted by its own variance. Pixels of one parity are not neighbours, so order does not matter.
    """
    height, width = albedo.shape
    normal2, albedo2, tail = np.float32(of_normal), np.float32(of_albedo), np.float32(inverse_cauchy2)
    for k in numba.prange(len(uncertain)):
        i, j = uncertain[k] // width, uncertain[k] % width
        if (i // stride + j // stride) % 2 != parity:
            continue
        rho, nx, ny, nz = albedo[i, j], normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
        x, y, z = rho * nx, rho * ny, rho * nz
        m0, m1, m2, m3, m4, m5 = own[k, 0], own[k, 1], own[k, 2], own[k, 3], own[k, 4], own[k, 5]
        b0 = own[k, 6] - (m0 * x + m1 * y + m2 * z)
        b1 = own[k, 7] - (m1 * x + m3 * y + m4 * z)
        b2 = own[k, 8] - (m2 * x + m4 * y + m5 * z)
        inverse = np.float32(1) / rho
        inverse2 = inverse * inverse
        for side in range(4):
            a = i + (stride if side == 0 else -stride if side == 1 else 0)
            b = j + (stride if side == 2 else -stride if side == 3 else 0)
            if a < 0 or b < 0 or a >= height or b >= width or variance[a, b] >= UNKNOWN:
                continue
            px, py, pz = normals[a, b, 0], normals[a, b, 1], normals[a, b, 2]
            cosine = nx * px + ny * py + nz * pz
            shade = np.float32(math.log(rho / albedo[a, b]))
            theirs = np.float32(0.5) * variance[a, b]
            turn = max(np.float32(2) - np.float32(2) * cosine, np.float32(0))
            w = np.float32(1) / (normal2 + theirs + turn * tail)  # of a tangential direction
            u = np.float32(1) / (albedo2 + theirs + shade * shade * tail)  # along g
            across, along = w * inverse2, (u - w) * inverse2
            m0 += across + along * nx * nx
            m1 += along * nx * ny
            m2 += along * nx * nz
            m3 += across + along * ny * ny
            m4 += along * ny * nz
            m5 += across + along * nz * nz
            towards, outwards = w * inverse, -(w * cosine + u * shade) * inverse
            b0 += towards * px + outwards * nx
            b1 += towards * py + outwards * ny
            b2 += towards * pz + outwards * nz
        dx, dy, dz, _ = _solved(m0, m1, m2, m3, m4, m5, b0, b1, b2, x, y, z)
        step = np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
        share = min(np.float32(1), np.float32(LARGEST_STEP) * rho / max(step, np.float32(1e-12)))
        x, y, z = x + share * dx, y + share * dy, z + share * dz
        length = np.float32(math.sqrt(x * x + y * y + z * z))
        albedo[i, j] = length
        normals[i, j, 0], normals[i, j, 1], normals[i, j, 2] = x / length, y / length, z / length
        _, _, _, variance[i, j] = _solved(m0, m1, m2, m3, m4, m5, b0, b1, b2, x, y, z)


KERNELS = (_solved, _weigh, _sweep)
