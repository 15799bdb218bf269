"""What of a normal map no surface can have is noise, and is taken out.

A normal has two unknowns and a surface but one at each pixel: its slopes across and down the picture are those of one
depth, so round any two by two pixels they add up to nothing. Pixels are solved one by one and know nothing of that.
What their slopes add up to is therefore error, and the least change of all normals, each weighed by how sure it is,
that makes them those of a surface takes half of the variance away that pixels do not share. It smooths nothing: relief
of any fineness is a surface and stays as it is, and lamps that are wrong tilt all normals much as a surface could.

Where the slopes round four pixels miss each other by more than their noise explains, or where the surface bends so much
that a pixel's mean normal has not its mean slope, the four are joined as loosely as that asks: at limbs, steps and
creases. The change is small, so slopes are linear in it, and local, so strips of rows are changed one after another.

Kernels compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.models.base import Float32Array
from acquisition.normals.regularisation import UNSURE_DEG

MISMATCH = 2.5
"""Whitened sum of the slopes round four pixels beyond which it is no noise."""

BENT = 0.05
"""1 σ of that sum, as a share of how much slopes differ among the four: pixels are not points."""

LEAST_COSINE = 0.05
"""Surfaces seen more edge-on than this, 87°, have no slope to speak of."""

ROUNDS = 10
"""Steps of conjugate gradients: noise is local, and after five of them errors fall by less than a hundredth."""

ROWS, AROUND = 256, 12
"""Rows of a strip, and those above and below that are solved with it for its own rows' sake."""


def settle(normals: Float32Array, sigma_deg: Float32Array, variance: Float32Array, ray: Float32Array) -> None:
    """Turns unit normals (H, W, 3), view frame, as little as makes them those of a surface, and lowers σ, in place.

    Where σ is large it is not noise but what too few lights leave open, which neighbours share, and it stays.

    `sigma_deg` (H, W) is 1 σ over both tangential directions, as in NormalMap, NaN where there is no normal; `variance`
    (H, W) in rad² is the part of its square that comes from errors which pixels do not share, and is lowered as well;
    `ray` (2, H, W) are the pixels' rays.
    """
    height, width = variance.shape
    if min(height, width) < 2:
        return
    pitch = np.float32(abs(ray[0, height // 2, -1] - ray[0, height // 2, 0]) / (width - 1))
    above = normals[:0].copy(), variance[:0].copy()
    for start in range(0, height, ROWS):
        stop, below = min(start + ROWS, height), min(start + ROWS + AROUND, height)
        there = np.isfinite(sigma_deg[start:below])
        strip = np.concatenate([above[0], normals[start:below]])
        before = np.concatenate([above[1], np.where(there, variance[start:below], 0)])
        first = len(above[0])
        last = first + stop - start
        above = strip[max(last - AROUND, 0) : last].copy(), before[max(last - AROUND, 0) : last]
        if len(strip) < 2:
            continue
        left = _settled(strip, before, ray[:, start - first : below], pitch)[first:last]
        normals[start:stop] = strip[first:last]
        gone = np.where(sigma_deg[start:stop] > UNSURE_DEG, 0, (1 - left) * before[first:last])
        sigma_deg[start:stop] = np.degrees(np.sqrt(np.radians(sigma_deg[start:stop]) ** 2 - gone))
        variance[start:stop] -= gone


def _settled(normals: Float32Array, variance: Float32Array, ray: Float32Array, pitch: np.float32) -> Float32Array:
    """Turns the normals (h, w, 3) of a strip, in place; the share (h, w) of their variance that is left.

    A variance of zero says that there is no normal.
    """
    height, width = variance.shape
    down, across = (np.gradient(ray, axis=axis) / pitch for axis in (1, 2))
    rays = np.ascontiguousarray(np.concatenate([ray, across, down]), np.float32)
    slope = np.empty((5, height, width), np.float32)
    _slopes(normals, variance, rays, slope)
    shape = (height + 1, width + 1)  # an unknown for each four pixels, and zeros at the border
    total, loose, inverse = (np.zeros(shape, np.float32) for _ in range(3))
    _sums(slope, total, loose, inverse)
    pull, change = np.zeros(shape, np.float32), np.empty((2, height, width), np.float32)
    way, image = inverse * total, np.zeros(shape, np.float32)
    remains = total
    power = float(np.vdot(remains, way))
    for _ in range(ROUNDS):
        if power <= 0:
            break
        _changes(way, slope, change)
        _misses(change, way, loose, image)
        step = np.float32(power / float(np.vdot(way, image)))
        pull += step * way
        remains -= step * image
        eased = inverse * remains
        before, power = power, float(np.vdot(remains, eased))
        way *= np.float32(power / before)
        way += eased
    _changes(pull, slope, change)
    left = np.empty((height, width), np.float32)
    _turn(normals, rays, slope, change, loose, inverse, left)
    return left


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,:,::1], float32[:,:,::1])",
    cache=True, parallel=True, fastmath={"contract", "arcp", "nsz", "reassoc"}, error_model="numpy",
)  # fmt: skip
def _slopes(normals: Float32Array, variance: Float32Array, rays: Float32Array, out: Float32Array) -> None:
    """Change of log depth to the right and down, in units of the pitch, and its covariance: p, q, C_pp, C_pq, C_qq.

    n·∂(Zr)/∂u = 0 gives p = −n·r_u / n·r; with the tangent t_u = r_u + p r a turn δn makes it −t_u·δn / n·r, so that
    noise which is alike in both tangential directions has the covariance σ²/2 (t·t) / (n·r)². Zero where there is none.
    """
    height, width = variance.shape
    for i in numba.prange(height):
        for j in range(width):
            nx, ny, nz = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
            x, y = rays[0, i, j], -rays[1, i, j]
            ax, ay, bx, by = rays[2, i, j], -rays[3, i, j], rays[4, i, j], -rays[5, i, j]
            towards = nx * x + ny * y - nz
            v = variance[i, j]
            for k in range(5):
                out[k, i, j] = 0.0
            if not (v > 0) or towards * towards < LEAST_COSINE**2 * (x * x + y * y + 1) or towards > 0:
                continue
            p, q = -(nx * ax + ny * ay) / towards, -(nx * bx + ny * by) / towards
            ux, uy, uz = ax + p * x, ay + p * y, -p
            vx, vy, vz = bx + q * x, by + q * y, -q
            v *= np.float32(0.5) / (towards * towards)
            out[0, i, j], out[1, i, j] = p, q
            out[2, i, j] = v * (ux * ux + uy * uy + uz * uz)
            out[3, i, j] = v * (ux * vx + uy * vy + uz * vz)
            out[4, i, j] = v * (vx * vx + vy * vy + vz * vz)


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _sums(slope: Float32Array, total: Float32Array, loose: Float32Array, inverse: Float32Array) -> None:
    """For each four pixels what their slopes add up to, how loosely they are joined, and 1 / the total variance."""
    height, width = slope.shape[1:]
    for i in numba.prange(height - 1):
        for j in range(width - 1):
            if slope[2, i, j] <= 0 or slope[2, i, j + 1] <= 0 or slope[2, i + 1, j] <= 0 or slope[2, i + 1, j + 1] <= 0:
                continue
            p00, p01, p10, p11 = slope[0, i, j], slope[0, i, j + 1], slope[0, i + 1, j], slope[0, i + 1, j + 1]
            q00, q01, q10, q11 = slope[1, i, j], slope[1, i, j + 1], slope[1, i + 1, j], slope[1, i + 1, j + 1]
            added = np.float32(0.5) * (p10 + p11 - p00 - p01 + q00 + q10 - q01 - q11)
            noise = np.float32(0.0)
            for k in range(2):
                noise += slope[2, i, j + k] + slope[2, i + 1, j + k] + slope[4, i, j + k] + slope[4, i + 1, j + k]
            mixed = slope[3, i, j + 1] + slope[3, i + 1, j] - slope[3, i, j] - slope[3, i + 1, j + 1]
            noise += np.float32(2.0) * mixed
            noise *= np.float32(0.25)
            bent = (p00 - p11) ** 2 + (p01 - p10) ** 2 + (q00 - q11) ** 2 + (q01 - q10) ** 2
            known = noise + np.float32(BENT**2) * bent
            whole = max(known, added * added / np.float32(MISMATCH**2))
            total[i + 1, j + 1] = added
            loose[i + 1, j + 1] = whole - noise
            inverse[i + 1, j + 1] = 1 / whole


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], float32[:,:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _changes(pull: Float32Array, slope: Float32Array, change: Float32Array) -> None:
    """By how much slopes (2, h, w) give way to a pull on each four pixels."""
    height, width = slope.shape[1:]
    half = np.float32(0.5)
    for i in numba.prange(height):
        for j in range(width):
            a, b, c, d = pull[i, j], pull[i, j + 1], pull[i + 1, j], pull[i + 1, j + 1]
            p, q = half * (a + b - c - d), half * (b + d - a - c)
            change[0, i, j] = slope[2, i, j] * p + slope[3, i, j] * q
            change[1, i, j] = slope[3, i, j] * p + slope[4, i, j] * q


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _misses(change: Float32Array, pull: Float32Array, loose: Float32Array, out: Float32Array) -> None:
    """What the changes of slopes add up to round each four pixels, and what looseness adds."""
    height, width = change.shape[1:]
    half = np.float32(0.5)
    for i in numba.prange(height - 1):
        for j in range(width - 1):
            across = change[0, i + 1, j] + change[0, i + 1, j + 1] - change[0, i, j] - change[0, i, j + 1]
            down = change[1, i, j] + change[1, i + 1, j] - change[1, i, j + 1] - change[1, i + 1, j + 1]
            out[i + 1, j + 1] = half * (across + down) + loose[i + 1, j + 1] * pull[i + 1, j + 1]


@numba.njit(
    "void(float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1],"
    " float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _turn(
    normals: Float32Array, rays: Float32Array, slope: Float32Array, change: Float32Array, loose: Float32Array,
    inverse: Float32Array, left: Float32Array,
) -> None:  # fmt: skip
    """Normals of the slopes less their changes, and the share of the variance that this leaves.

    Each four pixels are a measurement of a pixel's slopes, as uncertain as the other three together; that they are
    measured themselves meanwhile makes two thirds of it, which for pixels that are equally sure gives the exact half.
    """
    height, width = left.shape
    for i in numba.prange(height):
        for j in range(width):
            left[i, j] = 1.0
            if slope[2, i, j] <= 0:
                continue
            x, y = rays[0, i, j], -rays[1, i, j]
            p, q = slope[0, i, j] - change[0, i, j], slope[1, i, j] - change[1, i, j]
            ux, uy, uz = rays[2, i, j] + p * x, -rays[3, i, j] + p * y, -p
            vx, vy, vz = rays[4, i, j] + q * x, -rays[5, i, j] + q * y, -q
            nx, ny, nz = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            normals[i, j, 0], normals[i, j, 1], normals[i, j, 2] = nx / length, ny / length, nz / length
            told = np.float32(0)  # by those round the pixel, in units of what it knows itself
            for a in range(2):
                for b in range(2):
                    if inverse[i + a, j + b] <= 0:
                        continue
                    mixed = -slope[3, i, j] if a == b else slope[3, i, j]
                    own = np.float32(0.25) * (slope[2, i, j] + slope[4, i, j]) + np.float32(0.5) * mixed
                    held = loose[i + a, j + b]
                    others = 1 / inverse[i + a, j + b] - held - own
                    told += np.float32(0.5) * own / (np.float32(2 / 3) * others + held)
            left[i, j] = 1 / (1 + told)


KERNELS = (_slopes, _sums, _changes, _misses, _turn)
