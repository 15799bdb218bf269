"""Kernels over a height field that the camera sees: horizon gathering of radiosity, wall detection.

Light is gathered in planes through the viewing ray, marching outwards from a receiver. Each surface that rises above
the horizon so far fills the angle from α₁ to α₂ between the two. The cosine-weighted integral over that angle is that
of (a cos α + b sin α) cos α, with a and b the normal's components across the ray and along it, and has a closed form.
The ray march over the grid is the same for all receivers, so it is tabulated once.

Kernels compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.models.base import BoolArray, Float32Array

LEVELS = 3
"""Number of parts of a wall's height that have a radiosity of their own."""


@numba.njit("Tuple((float32[:,::1], int64[:,:,::1], float32[:,::1]))(int64, int64)", cache=True, error_model="numpy")
def _ray_march(azimuths: int, longest: int) -> tuple[Float32Array, np.ndarray, Float32Array]:
    """Tabulates a ray march over grid cells in each direction, as far as `longest` cells, one cell a step.

    Longer strides far away miss the walls of low steps, the brightest surfaces where a lamp faces them (decision 104).

    Returns the directions in the image (A, 2). Each step passes between two neighbouring cells, of one column if the
    direction is nearer to that of rows, else of one row. For these it returns row and column of the upper or left cell
    relative to the first (A, steps, 2), and the interpolation weight of the other one (A, steps).
    """
    directions = np.empty((azimuths, 2), np.float32)
    cells = np.empty((azimuths, longest, 2), np.int64)
    shares = np.empty((azimuths, longest), np.float32)
    for k in range(azimuths):
        azimuth = 2.0 * np.pi * (k + 0.5) / azimuths
        across, down = np.cos(azimuth), np.sin(azimuth)
        directions[k, 0], directions[k, 1] = across, down
        major = max(abs(across), abs(down))
        for n in range(longest):
            u, v = (n + 1) * across / major, (n + 1) * down / major
            if abs(across) >= abs(down):
                cells[k, n, 0], cells[k, n, 1] = np.floor(v), np.round(u)
                shares[k, n] = v - np.floor(v)
            else:
                cells[k, n, 0], cells[k, n, 1] = np.round(v), np.floor(u)
                shares[k, n] = u - np.floor(u)
    return directions, cells, shares


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], int32[:,::1], float32[:,:,::1], int32[:,::1],"
    " float32[:,:,::1], int64, float64, float32[:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def gather(  # noqa: PLR0912, PLR0915 - one fused kernel is the point
    point: Float32Array,  # (h, w, 3)
    receiver: Float32Array,  # (K, 3) points
    normal: Float32Array,  # (K, 3)
    cell: np.ndarray,  # (K, 2)
    radiosity: Float32Array,  # (h, w, F)
    wall_number: np.ndarray,  # (h, w)
    wall_radiosity: Float32Array,  # (W, LEVELS, F)
    azimuths: int,
    wall_slope: float,  # rise over run from which there is a wall
    out: Float32Array,  # (K, F)
) -> None:
    """Computes the irradiance of each receiver, the cosine-weighted integral of the radiosity of surfaces above
    its horizon in each azimuth. Nothing is received from outside the image."""
    height, width, count = radiosity.shape
    zero, one, half, steep = np.float32(0), np.float32(1), np.float32(0.5), np.float32(wall_slope)
    share_of_one, far = np.float32(2.0 / azimuths), np.float32(1e6)
    directions, cells, shares = _ray_march(azimuths, max(height, width))
    # Unsigned indices into flat arrays spare numba the check for negative ones.
    points, numbers = point.reshape(height * width, 3), wall_number.reshape(height * width)
    radiosities = radiosity.reshape(height * width, count)
    # Between two cells the surface is interpolated, except across a discontinuity: to the right, and down.
    discontinuous = np.zeros((2, height * width), np.bool_)
    for v in numba.prange(height):
        for u in range(width):
            for side in range(2):
                v1, u1 = v + side, u + 1 - side
                if v1 < height and u1 < width:
                    apart = abs(point[v1, u1, 0] - point[v, u, 0]) + abs(point[v1, u1, 1] - point[v, u, 1])
                    discontinuous[side, v * width + u] = abs(point[v1, u1, 2] - point[v, u, 2]) > steep * apart
    for i in numba.prange(receiver.shape[0]):
        px, py, pz = receiver[i, 0], receiver[i, 1], receiver[i, 2]
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        inverse = one / np.sqrt(px * px + py * py + pz * pz)
        vx, vy, vz = -px * inverse, -py * inverse, -pz * inverse  # to the camera
        b = nx * vx + ny * vy + nz * vz
        for f in range(count):
            out[i, f] = zero
        for k in range(azimuths):
            across, down = directions[k, 0], directions[k, 1]
            side = 1 if abs(across) >= abs(down) else 0
            beside = np.uintp(width if side else 1)
            rows, columns = np.uintp(height - side), np.uintp(width - 1 + side)
            # Unit vector across the viewing ray, towards that side of the image.
            dot = across * vx - down * vy
            tx, ty, tz = across - dot * vx, -down - dot * vy, -dot * vz
            inverse = one / np.sqrt(tx * tx + ty * ty + tz * tz)
            tx, ty, tz = tx * inverse, ty * inverse, tz * inverse
            a = nx * tx + ny * ty + nz * tz
            # Light arrives only from above the tangent plane, a cos α + b sin α > 0: from where tan α is `lowest`.
            steepest = far
            if b >= 0:
                square = np.float32(1) / (a * a + b * b)
                below = (b * a * a * square - a * (np.arctan2(a, b) + a * b * square)) * half
                lowest = max(-a / max(b, np.float32(1e-6)), -far)
            elif a > 0:
                steepest = -a / b
                lowest, below = -far, (b - np.float32(0.5 * np.pi) * a) * half
            else:
                continue
            near = np.uintp(cell[i, 0] * width + cell[i, 1])
            lx, ly, lz = points[near, 0], points[near, 1], points[near, 2]
            for n in range(cells.shape[1]):
                row, column = np.uintp(cell[i, 0] + cells[k, n, 0]), np.uintp(cell[i, 1] + cells[k, n, 1])
                if row >= rows or column >= columns:  # as unsigned, a negative one is very large
                    break
                first = row * np.uintp(width) + column
                second = first + beside
                share = shares[k, n]
                before, near = near, first if share < half else second
                if discontinuous[side, first]:
                    share = zero if share < half else one
                rest = one - share
                x = rest * points[first, 0] + share * points[second, 0]
                y = rest * points[first, 1] + share * points[second, 1]
                z = rest * points[first, 2] + share * points[second, 2]
                ex, ey, ez = x - px, y - py, z - pz
                wall, rise = numbers[before], z - lz
                jump = False
                if wall >= 0:
                    jump = rise > steep * np.sqrt((x - lx) ** 2 + (y - ly) ** 2)
                    if jump:  # the edge stands between the two cells
                        ex, ey = (x + lx) * half - px, (y + ly) * half - py
                outward = ex * tx + ey * ty + ez * tz
                upward = ex * vx + ey * vy + ez * vz
                if outward > 0 and upward > lowest * outward:
                    slope = min(upward / outward, steepest)
                    square = one / (one + slope * slope)
                    above = (a * (np.arctan(slope) + slope * square) + b * slope * slope * square) * half
                    weight = (above - below) * share_of_one
                    if jump:
                        middle = pz + (slope + max(lowest, (lz - pz) / outward)) * half * outward
                        level = int(min(max((middle - lz) / rise, zero), np.float32(0.999)) * LEVELS)
                        for f in range(count):
                            out[i, f] += weight * wall_radiosity[wall, level, f]
                    else:
                        for f in range(count):
                            out[i, f] += weight * radiosities[near, f]
                    lowest, below = slope, above
                lx, ly, lz = x, y, z


@numba.njit(
    "Tuple((int32[:,::1], int32[:,::1], float32[:,::1], float32[::1]))(float32[:,:,::1], boolean[:,::1], float64)",
    cache=True,
    error_model="numpy",
)
def find_walls(
    point: Float32Array, inside: BoolArray, wall_slope: float
) -> tuple[np.ndarray, np.ndarray, Float32Array, Float32Array]:
    """Detects walls at discontinuities: numbers (h, w), cells of the feet (W, 2), normals (W, 3), z of edges (W,)."""
    height, width = inside.shape
    number = np.full((height, width), -1, np.int32)
    cell = np.empty((height * width, 2), np.int32)
    normal = np.zeros((height * width, 3), np.float32)
    top = np.empty(height * width, np.float32)
    count = 0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            x, y, z = point[v, u, 0], point[v, u, 1], point[v, u, 2]
            across, up, highest = 0.0, 0.0, 0.0
            for dv in range(-1, 2):
                for du in range(-1, 2):
                    if (dv == 0 and du == 0) or not inside[v + dv, u + du]:
                        continue
                    dx, dy = point[v + dv, u + du, 0] - x, point[v + dv, u + du, 1] - y
                    rise = point[v + dv, u + du, 2] - z
                    run = np.sqrt(dx * dx + dy * dy)
                    if rise > wall_slope * run:
                        across -= dx / run * rise
                        up -= dy / run * rise
                        highest = max(highest, rise)
            length = np.sqrt(across * across + up * up)
            if highest > 0 and length > 0:
                number[v, u] = count
                cell[count, 0], cell[count, 1] = v, u
                normal[count, 0], normal[count, 1] = across / length, up / length
                top[count] = z + highest
                count += 1
    return number, cell[:count].copy(), normal[:count].copy(), top[:count].copy()


KERNELS = (_ray_march, gather, find_walls)
