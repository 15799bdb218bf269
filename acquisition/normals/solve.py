"""Images to normals: the loop of solving, integrating and self-calibrating, and the last solve.

Near light needs depth, depth needs normals, and intensities need both, so they are found in turn; that loop runs on a
grid coarse enough to cost nothing, because depth and intensities do not need every pixel. The last solve then sees
every pixel once, with the viewing axis as the mean of its weak prior and with a depth offset as a fourth unknown.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from acquisition import photometry
from acquisition.errors import ErrorCode, RigError
from acquisition.normals import integrate, lambert, observe, self_calibration, silhouette
from acquisition.normals.lambert import Estimate, Pixels
from acquisition.types import (
    ATTACHED,
    CAST,
    HIGHLIGHT,
    LIT,
    SATURATED,
    BoolArray,
    Calibration,
    Float32Array,
    FloatArray,
    Information,
    NormalMap,
    Observations,
    SolveSettings,
)

OFFSET_SIGMA_M = 0.003
"""1 σ of a pixel's depth offset in the joint solve."""

SHIFT_SIGMA_M = 0.03
"""1 σ of the object's mean depth as the caller gives it."""

FIRST_THRESHOLD = 0.15
LEAST_IMAGES_TO_CALIBRATE = 4
COARSE_PIXELS = 30_000
SAMPLES = 4000
CALIBRATION_SAMPLES = 2500
LEAST_SPREAD = 0.05
"""Smallest singular value of the unit light directions (scaled by √F): below, they lie in one plane."""


@dataclass(frozen=True)
class _Scene:
    """What the loop refines: depth of the window in m, log intensity per image, the whole object's shift."""

    depth_m: Float32Array
    log_intensity: FloatArray
    shift_m: float


def solve(
    observations: Observations,
    calibration: Calibration,
    settings: SolveSettings,
    *,
    initial_depth_m: float | Float32Array,
    region: BoolArray | None = None,
) -> NormalMap:
    """Solves all images taken so far.

    `initial_depth_m` is the object's rough depth along OpenCV's z (a number or an (H, W) map; 30 mm off is fine);
    `region` (H, W) is where the object can be, none: the whole image. Raises RigError normals.infeasible when fewer
    than three lights are usable, the lights are parallel or in one plane, or nothing is lit.
    """
    height, width = calibration.height, calibration.width
    lights = [light for _, light in observe.lit_shots(observations)]
    rows, columns = _window(region, height, width)
    stack = observe.read(observations, calibration, rows, columns)
    inside = np.ones(stack.values.shape[1:], np.bool_) if region is None else region[rows, columns]
    ray = photometry.rays(calibration, rows, columns)
    depth = np.broadcast_to(np.asarray(initial_depth_m, np.float32), (height, width))[rows, columns]
    lamp = photometry.lamps(lights)
    middle = _middle(ray, depth, inside)
    _refuse_flat_lights(lamp, middle)
    distance = float(np.mean(np.linalg.norm(lamp[:, :3] - middle, axis=1)))
    noise = photometry.noise(calibration, stack.exposures_s, distance, stack.ambient_dn)

    strength = _strength(ray, depth, lamp, calibration)
    found = silhouette.find(stack.values, strength, stack.clipped, inside)
    if np.count_nonzero(found) < 16:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no object was found in the region: check where it stands")
    pixels = _pixels(found, ray, stack.values, stack.clipped)
    scene = _refine(pixels, _Scene(depth.copy(), np.zeros(len(lights)), 0.0), lamp, calibration, noise, settings)

    along = photometry.ray_directions(pixels.ray)
    factors = np.exp(scene.log_intensity)
    final = lambert.solve(
        pixels, (pixels.values / factors[:, None]).astype(np.float32), pixels.take(scene.depth_m), lamp, calibration,
        noise,        threshold=settings.shadow_threshold, offset_sigma_m=OFFSET_SIGMA_M, robust=settings.robust,
    )  # fmt: skip
    normals = lambert.facing(final.normals, along)
    solved = np.count_nonzero(final.usable, axis=0) >= 2
    depth_map = integrate.depth(pixels.image(normals), found, ray, pixels.image(_certainty(final)), scene.depth_m)
    result = _Placed(pixels, solved, rows, columns, (height, width))
    chosen = _samples(pixels, solved)
    sigma = np.where(solved, np.degrees(np.sqrt(final.variance)), np.nan).astype(np.float32)
    window_rows, window_columns = np.unravel_index(pixels.index[chosen], pixels.shape)
    return NormalMap(
        normals=np.ascontiguousarray(result.place(normals).transpose(1, 2, 0)),
        albedo=result.place(final.albedo),
        depth=result.place(pixels.take(depth_map)),
        sigma_deg=result.place(sigma, np.nan),
        residual=result.place(final.residual),
        mask=result.place(solved, everywhere=True),
        silhouette=result.place(np.ones_like(solved), everywhere=True),
        flags=result.place(_flags(final, pixels, noise), everywhere=True),
        intensity_factors=factors,
        information=Information(
            rows=window_rows.astype(np.int64) + rows.start,
            columns=window_columns.astype(np.int64) + columns.start,
            matrices=lambert.information(final, chosen, lamp, along),
        ),
        noise={"intensity": noise.intensity, "direction": noise.direction, "shot": float(np.mean(noise.shot))},
        notes={"shift_m": scene.shift_m, "threshold": settings.shadow_threshold},
    )


@dataclass(frozen=True)
class _Placed:
    """Puts values at the object's pixels into the whole frame."""

    pixels: Pixels
    solved: BoolArray
    rows: slice
    columns: slice
    size: tuple[int, int]

    def place(self, values: np.ndarray, outside: float = 0.0, *, everywhere: bool = False) -> np.ndarray:
        """Values (..., N) over the frame (..., H, W); only solved pixels unless `everywhere`."""
        out = np.full((*values.shape[:-1], *self.size), outside, dtype=values.dtype)
        kept = values if everywhere else np.where(self.solved, values, np.asarray(outside, values.dtype))
        out[..., self.rows, self.columns] = self.pixels.image(kept, outside)
        return out


def _refine(
    pixels: Pixels, scene: _Scene, lamp: Float32Array, calibration: Calibration, noise: photometry.Noise,
    settings: SolveSettings,
) -> _Scene:  # fmt: skip
    """Depth and intensities, found in turn on a coarse grid; the depth comes back at full size."""
    factor = max(1, int(np.sqrt(len(pixels.index) / COARSE_PIXELS)))
    coarse = _coarser(pixels, factor)
    ray = coarse.image(coarse.ray)
    mask = coarse.image(np.ones(len(coarse.index), np.bool_))
    size = (coarse.shape[1], coarse.shape[0])
    depth = np.asarray(cv2.resize(scene.depth_m, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    ray_full = _fill_rays(ray, mask)
    rng = np.random.default_rng(0)
    sample = np.sort(rng.permutation(len(coarse.index))[:CALIBRATION_SAMPLES])
    log_intensity, shift = scene.log_intensity.copy(), scene.shift_m
    threshold = FIRST_THRESHOLD
    for _ in range(settings.depth_rounds):
        values = coarse.values / np.exp(log_intensity)[:, None].astype(np.float32)
        found = lambert.solve(
            coarse, values, coarse.take(depth), lamp, calibration, noise, threshold=threshold, robust=settings.robust
        )
        normals = lambert.facing(found.normals, photometry.ray_directions(coarse.ray))
        depth = integrate.depth(coarse.image(normals), mask, ray_full, coarse.image(_certainty(found)), depth)
        step = _calibrate(
            coarse.subset(sample), values[:, sample], coarse.take(depth)[sample], lamp, calibration, noise,
            settings, log_intensity, shift,
        )  # fmt: skip
        log_intensity = log_intensity + step.log_intensity
        shift += step.shift_m
        depth = depth + np.float32(step.shift_m) * mask
        threshold = settings.shadow_threshold
    return _Scene(_finer(depth, mask, factor, pixels, scene.depth_m), log_intensity, shift)


def _calibrate(
    pixels: Pixels, values: Float32Array, depth: Float32Array, lamp: Float32Array, calibration: Calibration,
    noise: photometry.Noise, settings: SolveSettings, log_intensity: FloatArray, shift: float,
) -> self_calibration.Shared:  # fmt: skip
    """The shared unknowns' total change over three Gauss–Newton steps."""
    many = len(lamp) >= LEAST_IMAGES_TO_CALIBRATE
    total = self_calibration.Shared(np.zeros(len(lamp)), 0.0)
    along = photometry.ray_directions(pixels.ray)
    for _ in range(3):
        found = lambert.solve(
            pixels, values / np.exp(total.log_intensity)[:, None].astype(np.float32),
            depth + np.float32(total.shift_m), lamp, calibration, noise,
            threshold=settings.shadow_threshold, offset_sigma_m=OFFSET_SIGMA_M, robust=settings.robust,
        )  # fmt: skip
        step = self_calibration.step(
            found.light, lambert.derivative(found.light, found.point, along, lamp),
            (values / np.exp(total.log_intensity)[:, None]).astype(np.float32), found.g, found.offset_m, found.weights,
            log_intensity + total.log_intensity, shift + total.shift_m,
            calibration.intensity_sigma if many else 0.0, SHIFT_SIGMA_M if many else 0.0, OFFSET_SIGMA_M,
        )  # fmt: skip
        total = self_calibration.Shared(total.log_intensity + step.log_intensity, total.shift_m + step.shift_m)
    return total


def _certainty(found: Estimate) -> Float32Array:
    """How far a pixel's normal is to be believed in integration, 0–1."""
    return (1.0 / (1.0 + found.variance / np.radians(3.0) ** 2)).astype(np.float32) + np.float32(1e-3)


def _flags(found: Estimate, pixels: Pixels, noise: photometry.Noise) -> np.ndarray:
    """Bit fields (F, N): what each measurement was."""
    predicted = np.einsum("fcn,cn->fn", found.light, found.g)
    strength = np.sqrt(np.einsum("fcn,fcn->fn", found.light, found.light)) * found.albedo
    dark = ~found.usable & ~pixels.clipped
    attached = dark & (predicted < 0.1 * strength)
    excess = pixels.values - predicted
    spread = np.sqrt(noise.variance(predicted, strength))
    highlight = found.usable & (excess > 4 * spread) & (excess > 0.03 * strength)
    return (
        LIT * found.usable + ATTACHED * attached + CAST * (dark & ~attached) + SATURATED * pixels.clipped
        + HIGHLIGHT * highlight
    ).astype(np.uint8)  # fmt: skip


def _window(region: BoolArray | None, height: int, width: int) -> tuple[slice, slice]:
    """The bounding box of the region."""
    if region is None:
        return slice(0, height), slice(0, width)
    if region.shape != (height, width) or not np.any(region):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE, "the region is empty or not of the image's size: draw it round the object"
        )
    rows, columns = np.flatnonzero(np.any(region, axis=1)), np.flatnonzero(np.any(region, axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _middle(ray: Float32Array, depth: Float32Array, inside: BoolArray) -> Float32Array:
    if not np.all(np.isfinite(depth)) or np.any(depth <= 0):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "the rough depth must be positive: check base_from_camera")
    return np.mean(photometry.points(ray[:, inside], depth[inside]), axis=1)


def _refuse_flat_lights(lamp: Float32Array, middle: Float32Array) -> None:
    offsets = lamp[:, :3] - middle
    units = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    spread = np.linalg.svd(units, compute_uv=False)[-1] / np.sqrt(len(units))
    if not spread > LEAST_SPREAD:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "the lights are parallel or lie in one plane with the object: take lights from other sides",
            spread=float(spread),
        )


def _strength(ray: Float32Array, depth: Float32Array, lamp: Float32Array, calibration: Calibration) -> Float32Array:
    point = photometry.points(ray, np.ascontiguousarray(depth)).reshape(3, -1)
    light = photometry.light_vectors(point, lamp, calibration)
    return np.sqrt(np.einsum("fcn,fcn->fn", light, light)).reshape(len(lamp), *depth.shape)


def _pixels(mask: BoolArray, ray: Float32Array, values: Float32Array, clipped: BoolArray) -> Pixels:
    index = np.flatnonzero(mask)
    count = len(values)
    return Pixels(
        shape=(mask.shape[0], mask.shape[1]),
        index=index,
        ray=np.ascontiguousarray(ray.reshape(2, -1)[:, index]),
        values=np.ascontiguousarray(values.reshape(count, -1)[:, index]),
        clipped=clipped.reshape(count, -1)[:, index],
    )


def _coarser(pixels: Pixels, factor: int) -> Pixels:
    """Means over blocks of factor × factor pixels, object pixels only; a block with a clipped pixel is clipped."""
    if factor == 1:
        return pixels
    height, width = -(-pixels.shape[0] // factor), -(-pixels.shape[1] // factor)
    row, column = np.unravel_index(pixels.index, pixels.shape)
    block = (row // factor) * width + column // factor
    index, inverse = np.unique(block, return_inverse=True)
    share = 1.0 / np.bincount(inverse)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(inverse, one) * share for one in values])

    return replace(
        pixels,
        shape=(height, width),
        index=index,
        ray=mean(pixels.ray).astype(np.float32),
        values=mean(pixels.values).astype(np.float32),
        clipped=mean(pixels.clipped) > 0,
    )


def _fill_rays(ray: Float32Array, mask: BoolArray) -> Float32Array:
    """Rays of blocks outside the object do not matter but must be finite."""
    return np.where(mask[None], ray, np.float32(0))


def _finer(depth: Float32Array, mask: BoolArray, factor: int, pixels: Pixels, start: Float32Array) -> Float32Array:
    """Coarse depth at full size; the object's depth is carried over its border first."""
    weight = mask.astype(np.float32)
    smooth = cv2.blur(depth * weight, (5, 5)) / np.maximum(cv2.blur(weight, (5, 5)), 1e-6)
    carried = np.where(mask, depth, np.where(cv2.blur(weight, (5, 5)) > 1e-6, smooth, depth)).astype(np.float32)
    full = cv2.resize(carried, (mask.shape[1] * factor, mask.shape[0] * factor), interpolation=cv2.INTER_LINEAR)[
        : pixels.shape[0], : pixels.shape[1]
    ]
    inside = pixels.image(np.ones(len(pixels.index), np.bool_))
    return np.where(inside, full, start).astype(np.float32)


def _samples(pixels: Pixels, solved: BoolArray) -> np.ndarray:
    """Numbers of at most SAMPLES solved pixels, spread evenly: one at random in each run of pixels along the rows."""
    numbers = np.flatnonzero(solved)
    if len(numbers) <= SAMPLES:
        return numbers
    edges = np.linspace(0, len(numbers), SAMPLES + 1)
    rng = np.random.default_rng(0)
    return numbers[np.minimum((edges[:-1] + rng.random(SAMPLES) * np.diff(edges)).astype(int), len(numbers) - 1)]
