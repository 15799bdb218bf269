"""The last solve: every pixel once, with the viewing axis as the mean of its weak prior and a depth offset as a fourth
unknown.

Blocks of rows are solved one after another and put into maps of the whole frame. A pixel's solve knows of its
neighbours only which of them are in shadow, once for each turn in which light is taken out, so a block solved with so
many rows more comes out as if it had been solved with all. A pixel with fewer than two usable lights gets no normal;
one with two gets one that leans on the prior, and a σ that says so. At last pixels that are unsure lean on those round
them, the normals are made those of a surface, and who is still unsure leans once more: neighbours are surer now.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import (
    ATTACHED,
    CAST,
    HIGHLIGHT,
    LIT,
    SATURATED,
    FisherInformation,
    NormalMap,
    SolveSettings,
)
from acquisition.normals import (
    alternation,
    integrability,
    integration,
    interreflection,
    memory_mapped,
    pixel_solve,
    regularisation,
    specular,
)
from acquisition.normals import residual_noise as residuals
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.pixel_solve import Estimate, Pixels
from acquisition.normals.pyramid import MaskedImages, PyramidLevel

MAX_INDIRECT_SHARE = 0.3
"""Share of indirect light in a pixel's images above which its σ is said to mean nothing."""

PRELIMINARY_ITERATIONS = 3
"""Rounds of the kernel where albedo and normals are wanted, and not their last digits."""

SAMPLE_PIXELS = 4000


@dataclass(frozen=True)
class Scene:
    """What pixels are solved with: lamps (F, 6), the noise of single pixels, the object's typical albedo (none: that of
    the pixels at hand)."""

    lamp: Float32Array
    calibration: Calibration
    noise: photometry.Noise
    settings: SolveSettings
    typical: float | None = None


@dataclass(frozen=True)
class _PixelSolution:
    """The last solve: the estimate, the light of nominal lamps (F, N), what of it was solved from (F, N), and what
    indirect light was taken out (F, N)."""

    estimate: Estimate
    measured: Float32Array
    values: Float32Array
    extra: Float32Array
    indirect: Float32Array | None


@dataclass(frozen=True)
class _BlockResult:
    """What was found in a block: maps by name (N, ...) of its own pixels, their flags (F, N), the sum of their light
    and of what of it is indirect, and the information of some pixels: which (K,) of its own, and matrices (K, 4, 4)."""

    maps: dict[str, np.ndarray]
    flags: np.ndarray
    light: float
    indirect: float
    sampled: np.ndarray
    matrices: FloatArray


def noise_sample(count: int) -> np.ndarray:
    """Numbers (K,) of some of `count` pixels, sorted: those that show the noise."""
    return np.sort(np.random.default_rng(1).permutation(count)[:SAMPLE_PIXELS])


def with_residual_noise(few: Pixels, refined: AlternationResult, model: Scene) -> Scene:
    """The model with the noise of single pixels, as a sample of them shows it once everything else is known."""
    along = photometry.ray_directions(few.ray)
    noise = replace(model.noise, intensity=refined.noise.intensity, direction=refined.noise.direction)
    typical = None
    for _ in range(2):
        final = _solve_pixels(few, refined, replace(model, noise=noise))
        noise = residuals.estimate(
            final.estimate, final.values, noise, model.noise, along, model.lamp, alternation.OFFSET_SIGMA_M, final.extra
        )
        typical = pixel_solve.median_albedo(final.estimate, final.measured, few.clipped)
    return replace(model, noise=noise, typical=typical)


def solve(
    seen: MaskedImages, gathered: PyramidLevel, refined: AlternationResult, model: Scene, size: tuple[int, int]
) -> NormalMap:
    """The object's pixels, from what was `refined` on the coarse grid, as maps of the whole frame (H, W) of `size`."""
    images, shape = seen.images, seen.mask.shape
    place = (images.rows, images.columns)
    maps = _empty_maps(size)
    surface = _integration_inputs(shape, stepped=bool(np.any(refined.continuity_weight < 1)))
    windows = {name: image[place] for name, image in maps.items()} | surface
    flags = memory_mapped.zeros((len(images.lights), *size))
    even = _stratified_sample(int(np.count_nonzero(seen.mask)))
    numbers: list[np.ndarray] = []
    matrices: list[FloatArray] = []
    before, light, indirect = 0, 0.0, 0.0
    around = 1 if _direct_diffuse(refined) else 3
    for rows in seen.blocks():
        mask = seen.mask[rows]
        after = before + int(np.count_nonzero(mask))
        chosen = even[np.searchsorted(even, before) : np.searchsorted(even, after)] - before
        if after > before:
            found = _solve_block(seen, rows, around, gathered, refined, model, chosen)
            for name, window in windows.items():
                window[rows][mask] = found.maps[name]
            for image, told in zip(flags, found.flags, strict=True):
                image[place][rows][mask] = told
            light, indirect = light + found.light, indirect + found.indirect
            memory_mapped.release(flags)
            numbers.append(np.flatnonzero(mask)[found.sampled] + rows.start * shape[1])
            matrices.append(found.matrices)
        before = after
    del windows
    _regularise(maps["normals"][place], maps["sigma_deg"][place], surface["variance"], seen.ray)
    depth = integration.depth(
        maps["normals"][place].transpose(2, 0, 1), seen.mask, seen.ray, integration.certainty(surface.pop("variance")),
        surface.pop("start"), whole=surface.pop("whole", None), keep_steps=model.settings.keep_steps,
    )  # fmt: skip
    unsolved = ~maps["mask"]
    maps["normals"][unsolved] = 0
    maps["depth"] = np.zeros(size, np.float32)
    maps["depth"][place] = depth
    maps["depth"][unsolved] = 0
    window_rows, window_columns = np.unravel_index(np.concatenate(numbers), shape)
    noise = model.noise
    return NormalMap(
        **maps,
        flags=flags,
        intensity_factors=np.exp(refined.shared.log_intensity),
        information=FisherInformation(
            rows=window_rows.astype(np.int64) + images.rows.start,
            columns=window_columns.astype(np.int64) + images.columns.start,
            matrices=np.concatenate(matrices),
        ),
        noise={"intensity": noise.intensity, "direction": noise.direction, "shot": float(np.mean(noise.shot))},
        notes={
            "shift_m": refined.shared.shift_m,
            "lamps_aside_m": refined.shared.lamp_offset_m.tolist(),
            "threshold": model.settings.shadow_threshold,
            "interreflection": {"share": indirect / light, "scale": refined.indirect_scale},
            "lobe": {"strength": refined.lobe.strength, "exponent": refined.lobe.exponent},
        },
    )


def _regularise(normals: Float32Array, sigma_deg: Float32Array, variance: Float32Array, ray: Float32Array) -> None:
    """Changes what pixels found alone, in place, by what those round them did; as for `integrable.settle`."""
    regularisation.smooth_uncertain(normals, sigma_deg)
    lowered = np.radians(sigma_deg)
    lowered *= lowered
    np.fmin(variance, lowered, out=variance)
    integrability.settle(normals, sigma_deg, variance, ray)
    regularisation.smooth_uncertain(normals, sigma_deg)


def _empty_maps(size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Maps (H, W, ...) as they are outside of the object."""
    maps: dict[str, np.ndarray] = {name: np.zeros(size, np.float32) for name in ("albedo", "residual", "indirect")}
    maps |= {name: np.zeros(size, np.bool_) for name in ("mask", "silhouette", "doubtful")}
    maps["normals"] = np.zeros((*size, 3), np.float32)
    maps["sigma_deg"] = np.full(size, np.nan, np.float32)
    return maps


def _integration_inputs(shape: tuple[int, int], *, stepped: bool) -> dict[str, np.ndarray]:
    """What is wanted of the window (h, w) beside the normals to join and to integrate them, as it is outside of the
    object."""
    maps = {"variance": np.zeros(shape, np.float32), "start": np.ones(shape, np.float32)}
    return maps | ({"whole": np.ones(shape, np.float32)} if stepped else {})


def _solve_block(
    seen: MaskedImages,
    rows: slice,
    around: int,
    gathered: PyramidLevel,
    refined: AlternationResult,
    model: Scene,
    chosen: np.ndarray,
) -> _BlockResult:
    """Solves some rows with so many `around` them; `chosen` (K,) are its own pixels whose information is wanted."""
    read = slice(max(rows.start - around, 0), min(rows.stop + around, seen.mask.shape[0]))
    pixels = seen.pixels(read)
    here = refined.resampled(lambda values: gathered.interpolate(values, pixels, read.start))
    last = _solve_pixels(pixels, here, model)
    final, along = last.estimate, photometry.ray_directions(pixels.ray)
    first = int(np.count_nonzero(seen.mask[read.start : rows.start]))
    own = slice(first, first + int(np.count_nonzero(seen.mask[rows])))

    used = np.count_nonzero(final.usable, axis=0)
    solved = used >= 2
    sigma = np.degrees(np.sqrt(final.variance + here.shared_variance)).astype(np.float32)
    bounced = np.zeros_like(last.measured) if last.indirect is None else last.indirect
    light, indirect = np.maximum(np.sum(last.measured, axis=0), 1e-6), np.sum(bounced, axis=0)
    share = (indirect / light).astype(np.float32)
    maps = {
        "normals": pixel_solve.clamp_to_visible(final.normals, along).T,
        "albedo": np.where(solved, final.albedo, 0),
        "residual": np.where(solved, final.residual, 0),
        "indirect": np.where(solved, share, 0),
        "sigma_deg": np.where(solved, sigma, np.nan),
        "mask": solved,
        "silhouette": np.ones_like(solved),
        "doubtful": solved & ((used < 3) | (share > MAX_INDIRECT_SHARE)),
        "variance": final.variance,
        "start": here.depth_m,
        "whole": here.continuity_weight,
    }
    told = chosen[solved[own][chosen]]
    return _BlockResult(
        maps={name: values[own] for name, values in maps.items()},
        flags=_measurement_flags(final, last.measured, bounced, pixels.clipped, model.noise)[:, own],
        light=float(np.sum(light[own], dtype=np.float64)),
        indirect=float(np.sum(indirect[own], dtype=np.float64)),
        sampled=told,
        matrices=pixel_solve.fisher_information(final, told + first, model.lamp, along),
    )


def _direct_diffuse(refined: AlternationResult) -> bool:
    """Whether there is no light to be taken out."""
    return refined.indirect_irradiance is None and refined.lobe.strength == 0


def _solve_pixels(pixels: Pixels, refined: AlternationResult, model: Scene) -> _PixelSolution:
    """Solves some pixels; bounced light needs the albedo and gloss the normals, so they are taken out in turns."""
    measured = alternation.divide_intensity(pixels.values, refined.shared.log_intensity)

    def once(
        values: Float32Array, extra: Float32Array, rounds: int, gloss: specular.HighlightDerivatives | None = None
    ) -> Estimate:
        return pixel_solve.solve(
            pixels, values, refined.depth_m, model.lamp, model.calibration, model.noise,
            threshold=model.settings.shadow_threshold, offset_sigma_m=alternation.OFFSET_SIGMA_M,
            cauchy_scale=pixel_solve.CAUCHY_SCALE if model.settings.robust else None, extra=extra, rounds=rounds,
            typical=model.typical, highlight_by_g=None if gloss is None else gloss.by_g,
        )  # fmt: skip

    values, extra, indirect = measured, np.zeros_like(measured), None
    plain = _direct_diffuse(refined)
    found = once(values, extra, pixel_solve.IRLS_ITERATIONS if plain else PRELIMINARY_ITERATIONS)
    along = photometry.ray_directions(pixels.ray)
    for rounds in () if plain else (PRELIMINARY_ITERATIONS, pixel_solve.IRLS_ITERATIONS):
        gloss = refined.lobe.derivatives(found, along)
        highlight = np.zeros_like(measured) if gloss is None else gloss.highlight
        direct, values = values, measured - highlight
        extra = np.square(np.float32(specular.HIGHLIGHT_SIGMA) * highlight)
        if refined.indirect_irradiance is not None:
            indirect = interreflection.sent_on(refined.indirect_irradiance, values, direct, found.albedo)
            values = values - indirect
            extra = extra + np.square(np.float32(photometry.PREDICTED_BOUNCE_SIGMA) * indirect)
        found = once(values, extra, rounds, gloss)
    return _PixelSolution(found, measured, values, extra, indirect)


def _measurement_flags(
    found: Estimate, measured: Float32Array, indirect: Float32Array, clipped: BoolArray, noise: photometry.Noise
) -> np.ndarray:
    """Bit fields (F, N): what each measurement was, of images (F, N) as lamps of the nominal intensity give them.

    What is predicted to come from other surfaces (F, N) is no highlight, nor is what that prediction may miss.
    """
    flags = np.empty(found.usable.shape, np.uint8)
    scale = np.sqrt(noise.shot), np.sqrt(noise.floor)
    for number, (light, usable, burnt) in enumerate(zip(found.light, found.usable, clipped, strict=True)):
        predicted = np.einsum("cn,cn->n", light, found.g)
        strength = np.sqrt(np.einsum("cn,cn->n", light, light)) * found.albedo
        dark = ~usable & ~burnt
        attached = dark & (predicted < np.float32(0.1) * strength)
        spread = (
            np.float32(scale[0][number]) * np.sqrt(np.maximum(predicted, 0))
            + np.float32(scale[1][number])
            + np.float32(noise.intensity) * np.abs(predicted)
            + np.float32(noise.direction) * strength
            + np.float32(photometry.PREDICTED_BOUNCE_SIGMA) * indirect[number]
        )
        excess = measured[number] - indirect[number] - predicted
        highlight = usable & (excess > np.maximum(4 * spread, np.float32(0.03) * strength))
        flags[number] = (
            LIT * usable + ATTACHED * attached + CAST * (dark & ~attached) + SATURATED * burnt
            + HIGHLIGHT * highlight
        )  # fmt: skip
    return flags


def _stratified_sample(count: int) -> np.ndarray:
    """Numbers of at most SAMPLES of `count` pixels, spread evenly: one at random in each run along the rows."""
    if count <= SAMPLE_PIXELS:
        return np.arange(count)
    edges = np.linspace(0, count, SAMPLE_PIXELS + 1)
    rng = np.random.default_rng(0)
    return np.minimum((edges[:-1] + rng.random(SAMPLE_PIXELS) * np.diff(edges)).astype(int), count - 1)
