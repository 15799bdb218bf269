"""Depth with steps: integration of normals, cut where shadows begin, and levelled by how long they are.

Least squares over normals alone smears a step that the camera sees edge-on, since no normal tells of it. Its shadow
does: the ray from the lamp grazes the edge q and ends at the shadow's tip p, so that depth at q follows from depth at
p. Every run of dark pixels between two sharp borders, along the picture of the lamp's ray, is such an equation, and
somewhere on it the surface may be cut: where the camera sees it most edge-on, which is the limb of what is round, else
right behind the edge. It is cut on that side only, so that the equation lifts all that q belongs to and not q alone.
Cuts that no shadow shows are left to reweighting. The grid is coarse, so the sparse system is solved directly.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.normals.integration import LEAST_COSINE
from acquisition.normals.pixel_solve import Estimate, Pixels

DARK, LIT = 0.35, 0.45
"""Shares of a pixel's largest normalised value below which it is dark and above which it is lit. Level ground under a
lamp at 63° has 0.45 of its largest: it is lit, or the steepest lamps, whose shadows tell most exactly, tell nothing."""

BORDER = 2
"""Pixels within which a sharp border passes from dark to lit."""

SHORTEST = 2.0
EQUATION_WEIGHT = 0.03
"""Of a shadow's length against a normal's slope: half a pixel against three degrees."""

SCALE = 0.6
"""Slope error, in pixels, beyond which a pair of neighbours counts as cut."""

CUT = 1e-3
LOOSE = 0.03
"""Weights of a pair of neighbours that is cut, and of one where a shadow says that the surface may be."""

LIMB = 0.8
"""Cosine to the viewing ray below which a surface may be on its way to a limb."""

TOWARDS = 0.38
"""Sine of the angle, that of 22.5°, from which a shadow's way leads to a row's or a column's neighbour as well."""

WRONG = 4.0
"""Pixels by which a shadow may disagree before it counts as mistaken."""
LEAST_EQUATIONS = 30
LEAST_SHARE = 0.5
TELLING = 2.0
"""Steps are believed when so many shadows, and so large a share of them, contradict the depth from normals alone by so
many pixels: relief is full of short shadows that do not."""


@dataclass(frozen=True)
class _Equations:
    """log Z at `edge` − log Z at `tip` is `step`, for E pairs of pixels (numbers in the grid)."""

    edge: np.ndarray
    tip: np.ndarray
    step: np.ndarray

    def cuts(self, cosine: Float32Array) -> tuple[BoolArray, BoolArray]:
        """Whether the surface may be cut between a pixel and its neighbour below, and to its right, each (h w,), from
        its cosine (h, w) to the viewing ray."""
        width = cosine.shape[1]
        (row, column), (tip_row, tip_column) = (np.divmod(one, width) for one in (self.edge, self.tip))
        down, across = tip_row - row, tip_column - column
        length = np.hypot(down, across)
        down, across = down / length, across / length
        least = np.minimum(cosine[row, column], LIMB)
        at = np.stack([row, column])
        for way in range(1, int(np.max(length, initial=0))):
            on = np.flatnonzero(way < length - 0.5)
            there = np.rint([row[on] + way * down[on], column[on] + way * across[on]]).astype(int)
            steeper = cosine[there[0], there[1]] < least[on]
            on, there = on[steeper], there[:, steeper]
            least[on], at[:, on] = cosine[there[0], there[1]], there
        below, right = np.zeros(cosine.shape, np.bool_), np.zeros(cosine.shape, np.bool_)
        for pairs, towards, before in ((below, down, (1, 0)), (right, across, (0, 1))):
            there = np.abs(towards) > TOWARDS
            back = towards[there] < 0  # the pair is the earlier neighbour's
            pairs[at[0, there] - before[0] * back, at[1, there] - before[1] * back] = True
        return below.ravel(), right.ravel()


def depth(
    pixels: Pixels, values: Float32Array, found: Estimate, normals: Float32Array, certainty: Float32Array,
    start_m: Float32Array, smooth_m: Float32Array, lamp: Float32Array, rounds: int,
) -> tuple[Float32Array, Float32Array] | None:  # fmt: skip
    """Depth (N,) in m, and how whole the surface is at each pixel, 0–1 (N,); none where shadows show no step.

    `values` (F, N) without highlights, indirect light still in them: taken out by levels that are wrong, it would move
    the shadows' borders, by up to a pixel and all the same way. `normals` (3, N), `start_m` (N,) for the mean, for the
    shadows' rays and, when there is but one round of reweighting, for the cuts known so far. `smooth_m` (N,) is what
    normals alone give: where it explains the shadows too, there are no steps.
    """
    equations = _equations(pixels, values, found, start_m, lamp)
    slopes = _slopes(pixels, normals, certainty)
    p, q = slopes.first, slopes.second
    number = np.full(pixels.shape[0] * pixels.shape[1], -1)
    number[pixels.index] = np.arange(len(pixels.index))
    tip, edge = number[equations.tip], number[equations.edge]
    smooth = np.log(smooth_m)
    missed = np.abs(smooth[edge] - smooth[tip] - equations.step) > TELLING * slopes.pitch
    if np.count_nonzero(missed) < max(LEAST_EQUATIONS, LEAST_SHARE * len(missed)):
        return None
    along = photometry.ray_directions(pixels.ray)
    cosine = -np.sum(normals * along, axis=0) / np.sqrt(np.sum(along * along, axis=0))
    below, right = equations.cuts(pixels.image(cosine.astype(np.float32), 1.0))
    first = pixels.index[p]
    loose = np.where(np.where(slopes.across, right[first], below[first]), LOOSE, 1.0)
    at_start = np.log(start_m.astype(np.float64))
    solution = at_start
    for turn in range(rounds):
        wrong = (solution[edge] - solution[tip] - equations.step) / slopes.pitch
        # Before the first solution nothing can be said to be mistaken.
        believed = np.ones_like(wrong) if turn == 0 and rounds > 1 else 1 / (1 + (wrong / WRONG) ** 2)
        cut = np.maximum(slopes.unbroken(solution) * loose, CUT)
        solution = _solve(
            np.concatenate([p, tip]),
            np.concatenate([q, edge]),
            np.concatenate([slopes.step, equations.step]),
            np.concatenate([slopes.weight * cut, EQUATION_WEIGHT * believed]),
            at_start,
        )
    unbroken = slopes.unbroken(solution)
    whole = np.ones(len(pixels.index))
    np.minimum.at(whole, p, unbroken)
    np.minimum.at(whole, q, unbroken)
    return np.exp(solution).astype(np.float32), whole.astype(np.float32)


@dataclass(frozen=True)
class _Slopes:
    """What normals say of M pairs of neighbours (numbers of pixels): log Z at `second` − log Z at `first` is `step`."""

    first: np.ndarray
    second: np.ndarray
    across: BoolArray  # whether they are in one row
    step: np.ndarray
    weight: np.ndarray
    cosine: np.ndarray  # of the surface to the viewing ray
    pitch: float  # of pixels, in units of the rays

    def unbroken(self, solution: np.ndarray) -> np.ndarray:
        """How well a solution (N,) keeps each step, 0–1: near zero where the surface is cut."""
        misfit = (solution[self.second] - solution[self.first] - self.step) * self.cosine**2 / self.pitch
        return 1 / (1 + (misfit / SCALE) ** 2) ** 2


def _slopes(pixels: Pixels, normals: Float32Array, certainty: Float32Array) -> _Slopes:
    number = pixels.image(np.arange(len(pixels.index)), -1)
    pairs = [(number[:-1].ravel(), number[1:].ravel()), (number[:, :-1].ravel(), number[:, 1:].ravel())]
    p = np.concatenate([pair[0] for pair in pairs])
    q = np.concatenate([pair[1] for pair in pairs])
    across = np.repeat([False, True], [len(pair[0]) for pair in pairs])
    both = (p >= 0) & (q >= 0)
    p, q, across = p[both], q[both], across[both]
    along = photometry.ray_directions(pixels.ray)
    length = np.sqrt(np.sum(along[:, p] ** 2, axis=0))
    normal = normals[:, p] + normals[:, q]
    normal /= np.maximum(np.sqrt(np.sum(normal * normal, axis=0)), np.float32(1e-6))
    cosine = np.maximum(-np.sum(normal * (along[:, p] + along[:, q]), axis=0) / (2 * length), LEAST_COSINE)
    change = np.sum(normal * (along[:, q] - along[:, p]), axis=0) / length
    return _Slopes(
        first=p,
        second=q,
        across=across,
        step=change / cosine,
        weight=np.minimum(certainty[p], certainty[q]) * cosine**2,
        cosine=cosine,
        pitch=float(np.median(np.max(np.abs(pixels.ray[:, q] - pixels.ray[:, p]), axis=0))),
    )


def _solve(p: np.ndarray, q: np.ndarray, step: np.ndarray, weight: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Unknowns x (N,) with x_q − x_p ≈ step, drawn very weakly to `start`, whose mean they keep."""
    count = len(start)
    weak = np.full(count, 1e-7)
    rows = np.concatenate([p, q, p, q, np.arange(count)])
    columns = np.concatenate([p, q, q, p, np.arange(count)])
    data = np.concatenate([weight, weight, -weight, -weight, weak])
    matrix = coo_array((data, (rows, columns)), shape=(count, count)).tocsc()
    right = np.bincount(q, weight * step, count) - np.bincount(p, weight * step, count) + weak * start
    # Symmetric and positive definite: nothing is to be pivoted, which halves the time.
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    solution = np.asarray(factors.solve(right))
    return solution + np.mean(start - solution)


def _equations(
    pixels: Pixels, values: Float32Array, found: Estimate, depth_m: Float32Array, lamp: Float32Array
) -> _Equations:
    strength = np.sqrt(np.einsum("fcn,fcn->fn", found.light, found.light))
    ratio = values / np.maximum(strength, 1e-9)
    largest = np.max(np.where(pixels.clipped, 0, ratio), axis=0)
    share = np.where(pixels.clipped, 1.0, np.maximum(ratio / np.maximum(largest, 1e-6), 0))
    row, column = np.unravel_index(pixels.index, pixels.shape)
    across, down = np.polyfit(pixels.ray[0], column, 1), np.polyfit(pixels.ray[1], row, 1)
    rays = pixels.image(pixels.ray)
    depth_image = pixels.image(depth_m)
    edges, tips, steps = [], [], []
    for one, place in zip(share, lamp[:, :3].astype(float), strict=True):
        lamp_x, lamp_y, lamp_z = place[0], -place[1], -place[2]  # OpenCV's frame
        target = (across[0] * lamp_x / lamp_z + across[1], down[0] * lamp_y / lamp_z + down[1])
        image = pixels.image(one.astype(np.float32), -1.0)
        edge, tip = _runs(image, target[0], target[1], DARK, LIT, BORDER, SHORTEST)
        if len(edge) == 0:
            continue
        z, near, far = depth_image.ravel()[tip], rays.reshape(2, -1)[:, tip], rays.reshape(2, -1)[:, edge]
        wide = np.abs(far[0] - near[0]) > np.abs(far[1] - near[1])
        r_tip, r_edge = np.where(wide, near[0], near[1]), np.where(wide, far[0], far[1])
        aim = np.where(wide, lamp_x, lamp_y)
        # Both borders of the shadow lie half a pixel inside the lit pixels.
        apart = np.hypot(edge // image.shape[1] - tip // image.shape[1], edge % image.shape[1] - tip % image.shape[1])
        t = z * (r_tip - r_edge) / (r_edge * (lamp_z - z) - (aim - z * r_tip))
        change = 1 + t * (1 - 1 / apart) * (lamp_z - z) / z
        good = (t > 0) & (t < 0.3) & (change > 0)
        edges.append(edge[good])
        tips.append(tip[good])
        steps.append(np.log(change[good]))
    if not edges:
        return _Equations(np.zeros(0, int), np.zeros(0, int), np.zeros(0))
    return _Equations(np.concatenate(edges), np.concatenate(tips), np.concatenate(steps))


@numba.njit(
    "Tuple((int64[::1], int64[::1]))(float32[:,::1], float64, float64, float64, float64, int64, float64)",
    cache=True,
    error_model="numpy",
)
def _runs(  # noqa: PLR0912 - one fused kernel is the point
    share: Float32Array, target_u: float, target_v: float, dark: float, lit: float, border: int, shortest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Runs of dark pixels towards the lamp's picture at (target_u, target_v): the lit pixels at their far and near end.

    `share` (h, w) is −1 outside the object.
    """
    height, width = share.shape
    edges = np.empty(height * width, np.int64)
    tips = np.empty(height * width, np.int64)
    found = 0
    for v in range(height):
        for u in range(width):
            if share[v, u] < lit:
                continue
            along, down = target_u - u, target_v - v
            length = np.sqrt(along * along + down * down)
            if length < 1:
                continue
            along, down = along / length, down / length
            state, first, gap = 0, 0.0, 0
            s = 0.0
            while s < length:
                s += 1.0
                c, r = int(np.round(u + s * along)), int(np.round(v + s * down))
                if c < 0 or r < 0 or c >= width or r >= height or share[r, c] < 0:
                    break
                value = share[r, c]
                if state == 0:  # before the shadow: it must begin within the border
                    if value < dark:
                        state, first, gap = 1, s, 0
                    elif value >= lit or s > border:
                        break
                elif value >= lit:
                    if s - first >= shortest:
                        edges[found], tips[found] = r * width + c, v * width + u
                        found += 1
                    break
                elif value >= dark:
                    gap += 1
                    if gap >= border:
                        break
                else:
                    gap = 0
    return edges[:found].copy(), tips[:found].copy()


KERNELS = (_runs,)
