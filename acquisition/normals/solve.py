"""Images to normals: window and mask, the refining loop, the last solve, and the result as a map of the whole frame.

The last solve sees every pixel once, with the viewing axis as the mean of its weak prior and with a depth offset as a
fourth unknown. A pixel with fewer than two usable lights gets no normal; one with two gets one that leans on the prior,
and a σ that says so.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.errors import ErrorCode, RigError
from acquisition.measured import (
    ATTACHED,
    CAST,
    HIGHLIGHT,
    LIT,
    SATURATED,
    Calibration,
    Information,
    NormalMap,
    Observations,
    SolveSettings,
)
from acquisition.normals import integrate, interreflection, lambert, lobe, observe, refine, silhouette
from acquisition.normals import noise as residuals
from acquisition.normals.interreflection import Table
from acquisition.normals.lambert import Estimate, Pixels
from acquisition.normals.observe import Stack
from acquisition.normals.refine import Refined
from acquisition.types import BoolArray, Float32Array

BOUNCE_SIGMA = 0.1
"""1 σ of the predicted bounced light, as a share of it, that differs from light to light."""

LARGEST_SHARE = 0.3
"""Share of indirect light in a pixel's images above which its σ is said to mean nothing."""

FEW_ROUNDS = 3
"""Rounds of the kernel where albedo and normals are wanted, and not their last digits."""

SAMPLES = 4000
LEAST_SPREAD = 0.05
"""Smallest singular value of the unit light directions (scaled by √F): below, they lie in one plane."""


def solve(
    observations: Observations,
    calibration: Calibration,
    settings: SolveSettings,
    *,
    initial_depth_m: float | Float32Array,
    region: BoolArray | None = None,
    table_depth_m: Float32Array | None = None,
) -> NormalMap:
    """Solves all images taken so far.

    `initial_depth_m` is the object's rough depth along OpenCV's z (a number or an (H, W) map; 30 mm off is fine);
    `region` (H, W) is where the object can be, none: the whole image; `table_depth_m` (H, W) is the depth of the table
    it stands on, none: it stands on nothing that sends light. Raises RigError normals.infeasible when fewer
    than three lights are usable, the lights are parallel or in one plane, or nothing is lit.
    """
    rows, columns = _window(region, calibration.height, calibration.width)
    stack = observe.read(observations, calibration, rows, columns)
    return solve_stack(
        stack, calibration, settings, initial_depth_m=initial_depth_m, region=region, table_depth_m=table_depth_m
    )


def solve_stack(
    stack: Stack,
    calibration: Calibration,
    settings: SolveSettings,
    *,
    initial_depth_m: float | Float32Array,
    region: BoolArray | None = None,
    table_depth_m: Float32Array | None = None,
    object_mask: BoolArray | None = None,
) -> NormalMap:
    """Solves images of any source within the stack's window.

    `object_mask` (H, W) is the object's whole silhouette; none: it is found in the images, within `region`. The rest as
    for `solve`. All (H, W) are of the calibration's size. Raises RigError normals.infeasible as `solve` does.
    """
    height, width = calibration.height, calibration.width
    rows, columns = stack.rows, stack.columns
    _refuse_few(stack)
    inside = np.ones(stack.values.shape[1:], np.bool_) if region is None else region[rows, columns]
    ray = photometry.rays(calibration, rows, columns)
    depth = np.broadcast_to(np.asarray(initial_depth_m, np.float32), (height, width))[rows, columns]
    lamp = photometry.lamps(stack.lights)
    known = None if object_mask is None else object_mask[rows, columns] & inside
    middle = _middle(ray, depth, inside if known is None else known)
    _refuse_flat_lights(lamp, middle)
    distance = float(np.mean(np.linalg.norm(lamp[:, :3] - middle, axis=1)))
    noise = photometry.model_noise(calibration, stack.shot, stack.floor, distance)

    found = known
    if found is None:
        found = silhouette.find(stack.values, _strength(ray, depth, lamp, calibration), stack.clipped, inside)
    if np.count_nonzero(found) < 16:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no object was found in the region: check where it stands")
    pixels = _pixels(found, ray, stack.values, stack.clipped)
    table = None if table_depth_m is None else Table(table_depth_m[rows, columns], stack.values)
    refined = refine.refine(pixels, pixels.take(depth), lamp, calibration, noise, settings, table)

    along = photometry.ray_directions(pixels.ray)
    factors = np.exp(refined.log_intensity)
    noise = _noise(pixels, refined, lamp, calibration, noise, settings)
    last = _last(pixels, refined, lamp, calibration, noise, settings)
    final = last.estimate
    normals = lambert.facing(final.normals, along)
    solved = np.count_nonzero(final.usable, axis=0) >= 2
    start = pixels.image(refined.depth_m, float(np.mean(refined.depth_m)))
    depth_map = integrate.depth(
        pixels.image(normals), found, ray, pixels.image(refine.certainty(final)), start,
        whole=pixels.image(refined.whole),
    )  # fmt: skip
    result = _Placed(pixels, solved, rows, columns, (height, width))
    chosen = _samples(pixels, solved)
    variance = final.variance + refined.shared_variance
    sigma = np.where(solved, np.degrees(np.sqrt(variance)), np.nan).astype(np.float32)
    light = np.maximum(np.sum(refine.divided(pixels.values, refined.log_intensity), axis=0), 1e-6)
    share = np.zeros_like(light) if last.indirect is None else np.sum(last.indirect, axis=0) / light
    doubtful = solved & ((np.count_nonzero(final.usable, axis=0) < 3) | (share > LARGEST_SHARE))
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
        indirect=result.place(share.astype(np.float32)),
        doubtful=result.place(doubtful, everywhere=True),
        noise={"intensity": noise.intensity, "direction": noise.direction, "shot": float(np.mean(noise.shot))},
        notes={
            "shift_m": refined.shift_m,
            "threshold": settings.shadow_threshold,
            "interreflection": {"share": float(np.sum(share * light) / np.sum(light)), "scale": refined.bounce_scale},
            "lobe": {"strength": refined.lobe.strength, "exponent": refined.lobe.exponent},
        },
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


@dataclass(frozen=True)
class _Final:
    """The last solve: the estimate, what it was solved from (F, N), and what indirect light was taken out (F, N)."""

    estimate: Estimate
    values: Float32Array
    extra: Float32Array
    indirect: Float32Array | None


def _last(
    pixels: Pixels, refined: Refined, lamp: Float32Array, calibration: Calibration, noise: photometry.Noise,
    settings: SolveSettings,
) -> _Final:  # fmt: skip
    """The solve at full size; bounced light needs the albedo and gloss the normals, so they are taken out in turns."""
    measured = refine.divided(pixels.values, refined.log_intensity)

    def once(values: Float32Array, extra: Float32Array, rounds: int) -> Estimate:
        return lambert.solve(
            pixels, values, refined.depth_m, lamp, calibration, noise, threshold=settings.shadow_threshold,
            offset_sigma_m=refine.OFFSET_SIGMA_M, cauchy_scale=lambert.CAUCHY_SCALE if settings.robust else None,
            extra=extra, rounds=rounds,
        )  # fmt: skip

    values, extra, indirect = measured, np.zeros_like(measured), None
    matt = refined.lobe.strength == 0
    plain = refined.received is None and matt
    found = once(values, extra, lambert.ROUNDS if plain else FEW_ROUNDS)
    along = photometry.ray_directions(pixels.ray)
    for rounds in () if plain else (FEW_ROUNDS, lambert.ROUNDS):
        highlight = refined.lobe.highlight(found, along)
        direct, values = values, measured - highlight
        extra = np.square(np.float32(lobe.SIGMA) * highlight)
        if refined.received is not None:
            indirect = interreflection.sent_on(refined.received, values, direct, found.albedo)
            values = values - indirect
            extra = extra + np.square(np.float32(BOUNCE_SIGMA) * indirect)
        found = once(values, extra, rounds)
    return _Final(found, values, extra, indirect)


def _noise(
    pixels: Pixels, refined: Refined, lamp: Float32Array, calibration: Calibration, noise: photometry.Noise,
    settings: SolveSettings,
) -> photometry.Noise:  # fmt: skip
    """The noise of single pixels, as a sample of them shows it once everything else is known."""
    chosen = np.sort(np.random.default_rng(1).permutation(len(pixels.index))[:SAMPLES])
    few, part = pixels.subset(chosen), refined.subset(chosen)
    along = photometry.ray_directions(few.ray)
    noise = replace(noise, intensity=refined.noise.intensity, direction=refined.noise.direction)
    for _ in range(2):
        final = _last(few, part, lamp, calibration, noise, settings)
        noise = residuals.estimate(
            final.estimate, final.values, noise, along, lamp, refine.OFFSET_SIGMA_M, final.extra
        )  # fmt: skip
    return noise


def _flags(found: Estimate, pixels: Pixels, noise: photometry.Noise) -> np.ndarray:
    """Bit fields (F, N): what each measurement was."""
    flags = np.empty(found.usable.shape, np.uint8)
    scale = np.sqrt(noise.shot), np.sqrt(noise.floor)
    for number, (light, usable, clipped) in enumerate(zip(found.light, found.usable, pixels.clipped, strict=True)):
        predicted = np.einsum("cn,cn->n", light, found.g)
        strength = np.sqrt(np.einsum("cn,cn->n", light, light)) * found.albedo
        dark = ~usable & ~clipped
        attached = dark & (predicted < np.float32(0.1) * strength)
        spread = (
            np.float32(scale[0][number]) * np.sqrt(np.maximum(predicted, 0))
            + np.float32(scale[1][number])
            + np.float32(noise.intensity) * np.abs(predicted)
            + np.float32(noise.direction) * strength
        )
        excess = pixels.values[number] - predicted
        highlight = usable & (excess > np.maximum(4 * spread, np.float32(0.03) * strength))
        flags[number] = (
            LIT * usable + ATTACHED * attached + CAST * (dark & ~attached) + SATURATED * clipped
            + HIGHLIGHT * highlight
        )  # fmt: skip
    return flags


def _refuse_few(stack: Stack) -> None:
    if len(stack.lights) < 3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there are {len(stack.lights)} lit images and at least three are needed: take more lights",
            lights=len(stack.lights),
        )


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
    if not np.any(inside):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "the mask of the object is empty: draw it round the object")
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


def _samples(pixels: Pixels, solved: BoolArray) -> np.ndarray:
    """Numbers of at most SAMPLES solved pixels, spread evenly: one at random in each run of pixels along the rows."""
    numbers = np.flatnonzero(solved)
    if len(numbers) <= SAMPLES:
        return numbers
    edges = np.linspace(0, len(numbers), SAMPLES + 1)
    rng = np.random.default_rng(0)
    return numbers[np.minimum((edges[:-1] + rng.random(SAMPLES) * np.diff(edges)).astype(int), len(numbers) - 1)]
