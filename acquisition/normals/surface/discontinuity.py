"""Weighted least-squares normal integration (Quéau, Durou & Aujol 2018) with depth equations from cast shadows, IRLS.

Least squares over normals alone smears a depth discontinuity that the camera sees edge-on, because no normal shows it.
Its cast shadow does: the ray from the lamp grazes the occluding edge and ends at the shadow's tip, so the depth at the
edge follows from the depth at the tip (shape from shadows). Each run of dark pixels between two sharp borders, along
the image of the lamp's ray, gives such an equation.

The tip may be invisible, if the shadow leaves the object or ends on a wall that hides its end. The last dark pixel
still lies behind the grazing ray and bounds the depth at the edge from one side: a squared hinge in the least squares.

The surface may be discontinuous at one place of the run: where the camera sees it most edge-on, which is the occluding
contour of a round part, else right behind the edge. Only there is the prior weight of a pair of neighbours lowered. The
equation then lifts the whole surface behind the edge and not a single pixel. Discontinuities without a shadow are left
to iteratively reweighted least squares (Cauchy weights). The sparse normal equations are solved directly.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.tuned import tuned
from acquisition.normals.pixels.estimate import Estimate
from acquisition.normals.pixels.pixel_solve import Pixels


@dataclass(frozen=True)
class DiscontinuitySettings:
    """Tuned numbers of the search for depth discontinuities."""

    shadow_weight: float = tuned(0.03, "1")
    """Weight of a shadow's depth equation relative to a normal's slope, and of the slope of a pair of neighbours
    between which a shadow shows that the surface may be discontinuous. It is the squared ratio of errors, three degrees
    of a normal to half a pixel of a shadow: three degrees change a slope by 0.05 facing the camera and 0.10 at 45°:
    0.01–0.04."""
    robust_scale_px: float = tuned(0.6, "px")
    """Cauchy scale of the slope error, in pixels, beyond which a pair of neighbours counts as discontinuous. Measured:
    with 1 errors of 28 sound captures (design seeds 101–104) are 0.996 ± 0.009 of those with this value, but of eight
    objects from whose images 3 % too much was subtracted (seed 62) two are no longer recognised."""
    occluding_contour_cosine: float = tuned(0.8, "cosine")
    """Cosine to the viewing ray below which a surface may be near its occluding contour. Measured: with 1 errors of
    both machined parts (design seeds 45 and 62) are 2–3 % larger, and those of six other families unchanged."""


SETTINGS = DiscontinuitySettings()

LEAST_LAMP_M = 1e-9
"""Distance of a lamp from the camera or its plane, m, that counts as zero."""

WEIGHT_FLOOR = 1e-3
"""Least continuity weight of a pair of neighbours; it keeps the system well conditioned."""

LEAST_START_WEIGHT = 1e-7
"""Weight of the starting depth; it makes the system regular."""

NEIGHBOUR_SINE = 0.38
"""Sine of 22.5°, the angle from which a shadow's direction also crosses rows or columns."""


@dataclass(frozen=True)
class ShadowImages:
    """Images in which cast shadows are sought, at N pixels under F lamps.

    `measured` (F, N) are the values, `indirect` (F, N) is the indirect radiance in them, `estimate` their present
    solution, and `lamp` (F, 6 or 9) holds positions and axes in the view frame, m.
    """

    pixels: Pixels
    measured: Float32Array
    indirect: Float32Array
    estimate: Estimate
    lamp: Float32Array

    def lit_share(self, dark: float) -> Float32Array:
        """Ratio (F, N), 0–1, of each value per strength of light to the pixel's largest one; in shadow below `dark`.

        Highlights are subtracted, but indirect light is not: predicted by a depth that is still wrong, it would move
        all shadow borders the same way, by up to a pixel. Under very slanted lamps, surfaces that face the camera are
        as dark as shadows. Their share is set to `dark` at least where direct light exceeds ¾ of the prediction by
        normals and albedo.
        """
        light, clipped, ray = self.estimate.light, self.pixels.clipped, photometry.ray_directions(self.pixels.ray)
        strength = np.maximum(photometry.strength(light), np.float32(1e-9))
        values = self.measured - self.estimate.beside_direct_diffuse
        ratio = photometry.value_per_strength(values, strength)
        largest = np.maximum(np.max(np.where(clipped, 0, ratio), axis=0), np.float32(1e-6))
        share = np.where(clipped, np.float32(1), np.maximum(ratio / largest, 0))
        facing = -np.einsum("fcn,cn->fn", light, ray) / (strength * np.linalg.norm(ray, axis=0))
        unshadowed = np.maximum(self.estimate.lambertian(), 0)
        grazed = (facing < photometry.SETTINGS.grazing_cosine) & (4 * (values - self.indirect) > 3 * unshadowed)
        return np.where(grazed, np.maximum(share, np.float32(dark)), share)


@dataclass(frozen=True)
class _Equations:
    """Equations log Z at `edge` − log Z at `tip` = `step`, for a `bound` ≤ `step`, of E pairs of flat pixel indices."""

    edge: np.ndarray
    tip: np.ndarray
    step: np.ndarray
    bound: BoolArray

    def contradicted(self, log_depth: np.ndarray, least: float) -> BoolArray:
        """Marks the equations (E,) that a surface (h w,) misses, and bounds that it exceeds, by more than `least`."""
        residual = log_depth[self.edge] - log_depth[self.tip] - self.step
        return np.where(self.bound, residual, np.abs(residual)) > least

    def subset(self, chosen: BoolArray) -> "_Equations":
        """Returns the equations that are chosen (E,)."""
        return _Equations(self.edge[chosen], self.tip[chosen], self.step[chosen], self.bound[chosen])

    def discontinuities(self, cosine: Float32Array) -> tuple[BoolArray, BoolArray]:
        """Marks where the surface may be discontinuous between a pixel and its neighbour below, and to its right, each
        (h w,), from the cosine (h, w) of the surface to the viewing ray."""
        width = cosine.shape[1]
        (row, column), (tip_row, tip_column) = (np.divmod(index, width) for index in (self.edge, self.tip))
        down, across = tip_row - row, tip_column - column
        length = np.hypot(down, across)
        down, across = down / length, across / length
        least = np.minimum(cosine[row, column], SETTINGS.occluding_contour_cosine)
        steepest = np.stack([row, column])
        for distance in range(1, int(np.max(length, initial=0))):
            inside = np.flatnonzero(distance < length - 0.5)
            cell = np.rint([row[inside] + distance * down[inside], column[inside] + distance * across[inside]])
            cell = cell.astype(int)
            steeper = cosine[cell[0], cell[1]] < least[inside]
            inside, cell = inside[steeper], cell[:, steeper]
            least[inside], steepest[:, inside] = cosine[cell[0], cell[1]], cell
        below, right = np.zeros(cosine.shape, np.bool_), np.zeros(cosine.shape, np.bool_)
        for pairs, component, before in ((below, down, (1, 0)), (right, across, (0, 1))):
            chosen = np.abs(component) > NEIGHBOUR_SINE
            back = component[chosen] < 0  # the pair is the earlier neighbour's
            pairs[steepest[0, chosen] - before[0] * back, steepest[1, chosen] - before[1] * back] = True
        return below.ravel(), right.ravel()


def discontinuous_depth(
    shadows: ShadowImages, normals: Float32Array, confidence: Float32Array, start_m: Float32Array,
    continuous_m: Float32Array, rounds: int,
) -> tuple[Float32Array, Float32Array] | None:  # fmt: skip
    """Integrates normals with shadow equations by `rounds` of IRLS: depth (N,) in m and continuity weight (N,), 0–1.

    Returns none if fewer than `min_sample` equations contradict `continuous_m` (N,), the depth from normals alone.
    `normals` (3, N) are in the view frame, `confidence` (N,) is 0–1. `start_m` (N,) gives the mean depth, the shadows'
    rays and, for a single round, the discontinuities known so far.
    """
    pixels = shadows.pixels
    equations = _equations(shadows, start_m)
    slopes = _slopes(pixels, normals, confidence)
    p, q = slopes.first, slopes.second
    contradicted = equations.contradicted(
        pixels.image(np.log(continuous_m)).ravel(), photometry.SETTINGS.edge_px * slopes.pitch
    )
    equations = equations.subset(contradicted | ~equations.bound)
    if np.count_nonzero(contradicted) < photometry.SETTINGS.min_sample:
        return None
    number = np.full(pixels.shape[0] * pixels.shape[1], -1)
    number[pixels.index] = np.arange(len(pixels.index))
    tip, edge = number[equations.tip], number[equations.edge]
    ray = photometry.ray_directions(pixels.ray)
    cosine = np.sum(normals * photometry.towards_camera(ray), axis=0)
    below, right = equations.discontinuities(pixels.image(cosine.astype(np.float32), 1.0))
    first = pixels.index[p]
    prior = np.where(np.where(slopes.across, right[first], below[first]), SETTINGS.shadow_weight, 1.0)
    at_start = np.log(start_m.astype(np.float64))
    solution = at_start
    for iteration in range(rounds):
        residual = (solution[edge] - solution[tip] - equations.step) / slopes.pitch
        # Before the first solution no equation can be judged.
        robust = (
            np.ones_like(residual)
            if iteration == 0 and rounds > 1
            else 1 / (1 + (residual / (2 * photometry.SETTINGS.edge_px)) ** 2)
        )
        robust = robust * (~equations.bound | (residual > 0))  # a satisfied bound has no weight
        continuity = np.maximum(slopes.continuity_weight(solution) * prior, WEIGHT_FLOOR)
        solution = _solve(
            np.concatenate([p, tip]),
            np.concatenate([q, edge]),
            np.concatenate([slopes.step, equations.step]),
            np.concatenate([slopes.weight * continuity, SETTINGS.shadow_weight * robust]),
            at_start,
        )
    continuity = slopes.continuity_weight(solution)
    weight = np.ones(len(pixels.index))
    np.minimum.at(weight, p, continuity)
    np.minimum.at(weight, q, continuity)
    return np.exp(solution).astype(np.float32), weight.astype(np.float32)


@dataclass(frozen=True)
class _Slopes:
    """Log-depth slopes from normals: log Z at `second` − log Z at `first` = `step`, for M pairs of pixel numbers."""

    first: np.ndarray
    second: np.ndarray
    across: BoolArray  # whether they are in one row
    step: np.ndarray
    weight: np.ndarray
    cosine: np.ndarray  # of the surface to the viewing ray
    pitch: float  # of pixels, in units of the rays

    def continuity_weight(self, solution: np.ndarray) -> np.ndarray:
        """Returns the squared Cauchy weight (M,), 0–1, of each step's residual in a solution (N,); 0: discontinuous."""
        residual = (solution[self.second] - solution[self.first] - self.step) * self.cosine**2 / self.pitch
        return 1 / (1 + (residual / SETTINGS.robust_scale_px) ** 2) ** 2


def _slopes(pixels: Pixels, normals: Float32Array, confidence: Float32Array) -> _Slopes:
    """Returns the log-depth slopes of all pairs of neighbours from their mean normal, as in `integration.depth`."""
    number = pixels.image(np.arange(len(pixels.index)), -1)
    pairs = [(number[:-1].ravel(), number[1:].ravel()), (number[:, :-1].ravel(), number[:, 1:].ravel())]
    p = np.concatenate([pair[0] for pair in pairs])
    q = np.concatenate([pair[1] for pair in pairs])
    across = np.repeat([False, True], [len(pair[0]) for pair in pairs])
    both = (p >= 0) & (q >= 0)
    p, q, across = p[both], q[both], across[both]
    ray = photometry.ray_directions(pixels.ray)
    length = np.sqrt(np.sum(ray[:, p] ** 2, axis=0))
    normal = normals[:, p] + normals[:, q]
    normal /= np.maximum(np.sqrt(np.sum(normal * normal, axis=0)), np.float32(1e-6))
    cosine = np.maximum(
        -np.sum(normal * (ray[:, p] + ray[:, q]), axis=0) / (2 * length), photometry.SETTINGS.min_view_cosine
    )
    change = np.sum(normal * (ray[:, q] - ray[:, p]), axis=0) / length
    return _Slopes(
        first=p,
        second=q,
        across=across,
        step=change / cosine,
        weight=np.minimum(confidence[p], confidence[q]) * cosine**2,
        cosine=cosine,
        pitch=float(np.median(np.max(np.abs(pixels.ray[:, q] - pixels.ray[:, p]), axis=0))) if len(p) else np.inf,
    )


def _solve(p: np.ndarray, q: np.ndarray, step: np.ndarray, weight: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Solves x_q − x_p ≈ step for x (N,) by weighted least squares and sparse LU; x keeps the mean of `start`."""
    count = len(start)
    weak = np.full(count, LEAST_START_WEIGHT)
    rows = np.concatenate([p, q, p, q, np.arange(count)])
    columns = np.concatenate([p, q, q, p, np.arange(count)])
    data = np.concatenate([weight, weight, -weight, -weight, weak])
    matrix = coo_array((data, (rows, columns)), shape=(count, count)).tocsc()
    right = np.bincount(q, weight * step, count) - np.bincount(p, weight * step, count) + weak * start
    # The matrix is symmetric and positive definite, so pivoting is not needed; leaving it out halves the time. Narrow
    # panels take a fifth less time than SuperLU's default, because columns of a grid's factor share few rows.
    factors = splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, panel_size=2, options={"SymmetricMode": True}
    )
    solution = np.asarray(factors.solve(right))
    return solution + np.mean(start - solution)


def _equations(shadows: ShadowImages, depth_m: Float32Array) -> _Equations:
    """Builds the depth equations of all cast shadows: the grazing lamp ray intersects the viewing rays at both ends.

    Of the present depth `depth_m` (N,), that at the shadows' tips is used.
    """
    pixels = shadows.pixels
    lit = photometry.SETTINGS.grazing_cosine
    # Values that fade slowly from `lit` to `dark` are no shadow border. Images contain `dark` itself, in single
    # precision.
    dark = float(np.float32(3 * lit / 4))
    share = shadows.lit_share(dark)
    row, column = np.unravel_index(pixels.index, pixels.shape)
    across, down = np.polyfit(pixels.ray[0], column, 1), np.polyfit(pixels.ray[1], row, 1)
    rays = pixels.image(pixels.ray)
    depth_image = pixels.image(depth_m)
    edges, tips, steps, bounds = [], [], [], []
    for shading, position in zip(share, shadows.lamp[:, :3].astype(float), strict=True):
        if np.linalg.norm(position) <= LEAST_LAMP_M:  # the camera sees no shadow of a lamp at its place
            continue
        lamp_x, lamp_y, lamp_z = position[0], -position[1], -position[2]  # OpenCV's frame
        lamp_z = lamp_z if abs(lamp_z) > LEAST_LAMP_M else LEAST_LAMP_M
        target = (across[0] * lamp_x / lamp_z + across[1], down[0] * lamp_y / lamp_z + down[1])
        image = pixels.image(shading, -1.0)
        border = photometry.SETTINGS.edge_px
        edge, tip, bound = _shadow_runs(image, *target, dark, lit, border, border)
        if len(edge) == 0:
            continue
        z, near, far = depth_image.ravel()[tip], rays.reshape(2, -1)[:, tip], rays.reshape(2, -1)[:, edge]
        wide = np.abs(far[0] - near[0]) > np.abs(far[1] - near[1])
        r_tip, r_edge = np.where(wide, near[0], near[1]), np.where(wide, far[0], far[1])
        aim = np.where(wide, lamp_x, lamp_y)
        # Both borders of the shadow lie half a pixel inside the lit pixels. Of many bounds on one edge the tightest
        # decides, which noise would make too tight; so each bound leaves out the uncertain pixels of the border.
        apart = np.hypot(edge // image.shape[1] - tip // image.shape[1], edge % image.shape[1] - tip % image.shape[1])
        t = z * (r_tip - r_edge) / (r_edge * (lamp_z - z) - (aim - z * r_tip))
        change = 1 + t * (1 - np.where(bound, photometry.SETTINGS.edge_px, 1) / apart) * (lamp_z - z) / z
        good = (t > 0) & (t < 0.3) & (change > 0)
        edges.append(edge[good])
        tips.append(tip[good])
        steps.append(np.log(change[good]))
        bounds.append(bound[good])
    if not edges:
        return _Equations(np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros(0, np.bool_))
    return _Equations(np.concatenate(edges), np.concatenate(tips), np.concatenate(steps), np.concatenate(bounds))


@numba.njit(
    "Tuple((int64[::1], int64[::1], bool_[::1]))(float32[:,::1], float64, float64, float64, float64, int64, float64)",
    cache=True,
    error_model="numpy",
)
def _shadow_runs(  # noqa: PLR0912 - one fused kernel is the point
    share: Float32Array, target_u: float, target_v: float, dark: float, lit: float, border: int, shortest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scans for cast shadows towards the lamp's image at (target_u, target_v): lit pixels at their far and near end.

    `share` (h, w) is each pixel's value over its largest one, −1 outside the object. Returns flat indices of occluding
    edges and shadow tips, and whether they give a bound, from the last dark pixel, whether the tip is visible or not.
    """
    height, width = share.shape
    edges = np.empty(2 * height * width, np.int64)
    tips = np.empty(2 * height * width, np.int64)
    bounds = np.empty(2 * height * width, np.bool_)
    count = 0
    for v in range(height):
        for u in range(width):
            leaves = 0 <= share[v, u] < dark  # if the pixel before it is outside the object
            if not leaves and share[v, u] < lit:
                continue
            across, down = target_u - u, target_v - v
            length = np.sqrt(across * across + down * down)
            if length < 1:
                continue
            across, down = across / length, down / length
            if leaves:
                c, r = int(np.round(u - across)), int(np.round(v - down))
                if not (c < 0 or r < 0 or c >= width or r >= height or share[r, c] < 0):
                    continue
            state, first, gap, last = int(leaves), 0.0, 0, v * width + u
            s = 0.0
            while s < length:
                s += 1.0
                c, r = int(np.round(u + s * across)), int(np.round(v + s * down))
                if c < 0 or r < 0 or c >= width or r >= height or share[r, c] < 0:
                    break
                value = share[r, c]
                if state == 0:  # before the shadow: it must begin within the border
                    if value < dark:
                        state, first, gap, last = 1, s, 0, r * width + c
                    elif value >= lit or s > border:
                        break
                elif value >= lit:
                    if s - first >= shortest:
                        edges[count], tips[count], bounds[count] = r * width + c, last, True
                        count += 1
                        if not leaves:
                            edges[count], tips[count], bounds[count] = r * width + c, v * width + u, False
                            count += 1
                    break
                elif value >= dark:
                    gap += 1
                    if gap >= border:
                        break
                else:
                    gap = 0
    return edges[:count].copy(), tips[:count].copy(), bounds[:count].copy()


KERNELS = (_shadow_runs,)
