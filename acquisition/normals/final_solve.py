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
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED, Information, NormalMap, SolveSettings
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
from acquisition.normals.alternation import Refined
from acquisition.normals.pixel_solve import Estimate, Pixels
from acquisition.normals.pyramid import Gathered, Seen

LARGEST_SHARE = 0.3
"""Share of indirect light in a pixel's images above which its σ is said to mean nothing."""

FEW_ROUNDS = 3
"""Rounds of the kernel where albedo and normals are wanted, and not their last digits."""

SAMPLES = 4000


@dataclass(frozen=True)
class Model:
    """What pixels are solved with: lamps (F, 6), the noise of single pixels, the object's typical albedo (none: that of
    the pixels at hand)."""

    lamp: Float32Array
    calibration: Calibration
    noise: photometry.Noise
    settings: SolveSettings
    typical: float | None = None


@dataclass(frozen=True)
class _Final:
    """The last solve: the estimate, the light of nominal lamps (F, N), what of it was solved from (F, N), and what
    indirect light was taken out (F, N)."""

    estimate: Estimate
    measured: Float32Array
    values: Float32Array
    extra: Float32Array
    indirect: Float32Array | None


@dataclass(frozen=True)
class _Block:
    """What was found in a block: maps by name (N, ...) of its own pixels, their flags (F, N), the sum of their light
    and of what of it is indirect, and the information of some pixels: which (K,) of its own, and matrices (K, 4, 4)."""

    maps: dict[str, np.ndarray]
    flags: np.ndarray
    light: float
    indirect: float
    told: np.ndarray
    matrices: FloatArray


def sample(count: int) -> np.ndarray:
    """Numbers (K,) of some of `count` pixels, sorted: those that show the noise."""
    return np.sort(np.random.default_rng(1).permutation(count)[:SAMPLES])


def with_noise_of(few: Pixels, refined: Refined, model: Model) -> Model:
    """The model with the noise of single pixels, as a sample of them shows it once everything else is known."""
    along = photometry.ray_directions(few.ray)
    noise = replace(model.noise, intensity=refined.noise.intensity, direction=refined.noise.direction)
    typical = None
    for _ in range(2):
        final = _last(few, refined, replace(model, noise=noise))
        noise = residuals.estimate(
            final.estimate, final.values, noise, model.noise, along, model.lamp, alternation.OFFSET_SIGMA_M, final.extra
        )
        typical = pixel_solve.brightness(final.estimate, final.measured, few.clipped)
    return replace(model, noise=noise, typical=typical)


def solve(seen: Seen, gathered: Gathered, refined: Refined, model: Model, size: tuple[int, int]) -> NormalMap:
    """The object's pixels, from what was `refined` on the coarse grid, as maps of the whole frame (H, W) of `size`."""
    images, shape = seen.images, seen.mask.shape
    place = (images.rows, images.columns)
    maps = _outside(size)
    surface = _surface(shape, stepped=bool(np.any(refined.whole < 1)))
    windows = {name: image[place] for name, image in maps.items()} | surface
    flags = memory_mapped.zeros((len(images.lights), *size))
    even = _even(int(np.count_nonzero(seen.mask)))
    numbers: list[np.ndarray] = []
    matrices: list[FloatArray] = []
    before, light, indirect = 0, 0.0, 0.0
    around = 1 if _plain(refined) else 3
    for rows in seen.blocks():
        mask = seen.mask[rows]
        after = before + int(np.count_nonzero(mask))
        chosen = even[np.searchsorted(even, before) : np.searchsorted(even, after)] - before
        if after > before:
            found = _block(seen, rows, around, gathered, refined, model, chosen)
            for name, window in windows.items():
                window[rows][mask] = found.maps[name]
            for image, told in zip(flags, found.flags, strict=True):
                image[place][rows][mask] = told
            light, indirect = light + found.light, indirect + found.indirect
            memory_mapped.let_go(flags)
            numbers.append(np.flatnonzero(mask)[found.told] + rows.start * shape[1])
            matrices.append(found.matrices)
        before = after
    del windows
    _agree(maps["normals"][place], maps["sigma_deg"][place], surface["variance"], seen.ray)
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
        information=Information(
            rows=window_rows.astype(np.int64) + images.rows.start,
            columns=window_columns.astype(np.int64) + images.columns.start,
            matrices=np.concatenate(matrices),
        ),
        noise={"intensity": noise.intensity, "direction": noise.direction, "shot": float(np.mean(noise.shot))},
        notes={
            "shift_m": refined.shared.shift_m,
            "lamps_aside_m": refined.shared.aside_m.tolist(),
            "threshold": model.settings.shadow_threshold,
            "interreflection": {"share": indirect / light, "scale": refined.bounce_scale},
            "lobe": {"strength": refined.lobe.strength, "exponent": refined.lobe.exponent},
        },
    )


def _agree(normals: Float32Array, sigma_deg: Float32Array, variance: Float32Array, ray: Float32Array) -> None:
    """Changes what pixels found alone, in place, by what those round them did; as for `integrable.settle`."""
    regularisation.smooth_uncertain(normals, sigma_deg)
    lowered = np.radians(sigma_deg)
    lowered *= lowered
    np.fmin(variance, lowered, out=variance)
    integrability.settle(normals, sigma_deg, variance, ray)
    regularisation.smooth_uncertain(normals, sigma_deg)


def _outside(size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Maps (H, W, ...) as they are outside of the object."""
    maps: dict[str, np.ndarray] = {name: np.zeros(size, np.float32) for name in ("albedo", "residual", "indirect")}
    maps |= {name: np.zeros(size, np.bool_) for name in ("mask", "silhouette", "doubtful")}
    maps["normals"] = np.zeros((*size, 3), np.float32)
    maps["sigma_deg"] = np.full(size, np.nan, np.float32)
    return maps


def _surface(shape: tuple[int, int], *, stepped: bool) -> dict[str, np.ndarray]:
    """What is wanted of the window (h, w) beside the normals to join and to integrate them, as it is outside of the
    object."""
    maps = {"variance": np.zeros(shape, np.float32), "start": np.ones(shape, np.float32)}
    return maps | ({"whole": np.ones(shape, np.float32)} if stepped else {})


def _block(
    seen: Seen, rows: slice, around: int, gathered: Gathered, refined: Refined, model: Model, chosen: np.ndarray
) -> _Block:
    """Solves some rows with so many `around` them; `chosen` (K,) are its own pixels whose information is wanted."""
    read = slice(max(rows.start - around, 0), min(rows.stop + around, seen.mask.shape[0]))
    pixels = seen.pixels(read)
    here = refined.at(lambda values: gathered.at(values, pixels, read.start))
    last = _last(pixels, here, model)
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
        "normals": pixel_solve.facing(final.normals, along).T,
        "albedo": np.where(solved, final.albedo, 0),
        "residual": np.where(solved, final.residual, 0),
        "indirect": np.where(solved, share, 0),
        "sigma_deg": np.where(solved, sigma, np.nan),
        "mask": solved,
        "silhouette": np.ones_like(solved),
        "doubtful": solved & ((used < 3) | (share > LARGEST_SHARE)),
        "variance": final.variance,
        "start": here.depth_m,
        "whole": here.whole,
    }
    told = chosen[solved[own][chosen]]
    return _Block(
        maps={name: values[own] for name, values in maps.items()},
        flags=_flags(final, last.measured, bounced, pixels.clipped, model.noise)[:, own],
        light=float(np.sum(light[own], dtype=np.float64)),
        indirect=float(np.sum(indirect[own], dtype=np.float64)),
        told=told,
        matrices=pixel_solve.information(final, told + first, model.lamp, along),
    )


def _plain(refined: Refined) -> bool:
    """Whether there is no light to be taken out."""
    return refined.received is None and refined.lobe.strength == 0


def _last(pixels: Pixels, refined: Refined, model: Model) -> _Final:
    """Solves some pixels; bounced light needs the albedo and gloss the normals, so they are taken out in turns."""
    measured = alternation.divided(pixels.values, refined.shared.log_intensity)

    def once(values: Float32Array, extra: Float32Array, rounds: int, gloss: specular.Change | None = None) -> Estimate:
        return pixel_solve.solve(
            pixels, values, refined.depth_m, model.lamp, model.calibration, model.noise,
            threshold=model.settings.shadow_threshold, offset_sigma_m=alternation.OFFSET_SIGMA_M,
            cauchy_scale=pixel_solve.CAUCHY_SCALE if model.settings.robust else None, extra=extra, rounds=rounds,
            typical=model.typical, highlight_by_g=None if gloss is None else gloss.by_g,
        )  # fmt: skip

    values, extra, indirect = measured, np.zeros_like(measured), None
    plain = _plain(refined)
    found = once(values, extra, pixel_solve.ROUNDS if plain else FEW_ROUNDS)
    along = photometry.ray_directions(pixels.ray)
    for rounds in () if plain else (FEW_ROUNDS, pixel_solve.ROUNDS):
        gloss = refined.lobe.change(found, along)
        highlight = np.zeros_like(measured) if gloss is None else gloss.highlight
        direct, values = values, measured - highlight
        extra = np.square(np.float32(specular.SIGMA) * highlight)
        if refined.received is not None:
            indirect = interreflection.sent_on(refined.received, values, direct, found.albedo)
            values = values - indirect
            extra = extra + np.square(np.float32(photometry.PREDICTED_BOUNCE_SIGMA) * indirect)
        found = once(values, extra, rounds, gloss)
    return _Final(found, measured, values, extra, indirect)


def _flags(
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


def _even(count: int) -> np.ndarray:
    """Numbers of at most SAMPLES of `count` pixels, spread evenly: one at random in each run along the rows."""
    if count <= SAMPLES:
        return np.arange(count)
    edges = np.linspace(0, count, SAMPLES + 1)
    rng = np.random.default_rng(0)
    return np.minimum((edges[:-1] + rng.random(SAMPLES) * np.diff(edges)).astype(int), count - 1)
