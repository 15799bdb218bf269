"""Final solve at full resolution: every pixel once, with σ from its covariance.

The mean of the weak prior is the viewing axis, not the neighbours' normals, which are wrong beside walls and in holes.
A pixel with fewer than two usable lights gets no normal. With two lights the prior determines the normal along one
direction, and σ is accordingly large.

Blocks of rows are solved separately, in any process (`BlockMap`). A pixel depends on its neighbours only through which
of them are in shadow, and this reaches one row further with each solve after light is subtracted. With a margin of as
many rows on either side, a block gets the same result as all rows together. Afterwards the normals are projected onto
those of an integrable surface and regressed on their neighbours, σ is evaluated, and uncertain normals are regularised.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition import image_values, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.result import FisherInformation, NormalMap
from acquisition.normals import alternation
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.images import memory_mapped
from acquisition.normals.indirect_light import interreflection
from acquisition.normals.pixels import measurement_flags, microfacet, pixel_solve, robust_solve, term_solve
from acquisition.normals.pixels.pixel_solve import Estimate, Lighting, Pixels, Scene
from acquisition.normals.pyramid import MaskedImages, PyramidLevel
from acquisition.normals.surface import integrability, integration, local_regression, markov_field
from acquisition.normals.uncertainty import error_variance, goodness_of_fit, residual_noise
from acquisition.normals.uncertainty.goodness_of_fit import Fit

PRELIMINARY_ITERATIONS = 3
"""Iterations of a solve whose albedo and normals serve only to subtract light."""

SAMPLE_PIXELS = 4000
"""Pixels from which the noise is estimated, and most pixels whose Fisher information the planner gets."""


@dataclass(frozen=True)
class PixelSolution:
    """Final solve of N pixels: the estimate, `measured` values of nominal lamps (F, N), the `values` that were solved
    after subtraction of `indirect` light (F, N), their variance beyond the noise model's (F, N), and which are hardly
    lit (N,)."""

    estimate: Estimate
    measured: Float32Array
    values: Float32Array
    extra_variance: Float32Array
    indirect: Float32Array | None
    hardly_lit: BoolArray

    @property
    def variance(self) -> Float32Array:
        """Variance (N,), rad², of the normals; that of a random normal where hardly any lamp reaches."""
        return np.where(self.hardly_lit, np.float32(photometry.RANDOM_NORMAL_VARIANCE), self.estimate.variance)


@dataclass(frozen=True)
class Block:
    """Rows of the window that are solved at once, and numbers (K,) of the pixels that need Fisher information."""

    rows: slice
    chosen: np.ndarray


@dataclass(frozen=True)
class BlockResult:
    """Solution of a block's own pixels: maps by name (N, ...), flags (F, N), sums of all and of indirect light, and
    Fisher information (K, 4, 4) of the pixels with the numbers `sampled` (K,)."""

    maps: dict[str, np.ndarray]
    flags: np.ndarray
    light: float
    indirect: float
    sampled: np.ndarray
    matrices: FloatArray


@dataclass(frozen=True)
class BlockSolver:
    """Solves blocks, given what all pixels share; picklable. `masked` begins at the window's row `top` and has `margin`
    rows on either side of the blocks, as far as the window has them."""

    masked: MaskedImages
    level: PyramidLevel
    state: AlternationResult
    scene: Scene
    margin: int
    top: int = 0

    def within(self, rows: slice) -> "BlockSolver":
        """Returns a solver of blocks within some rows of the window that holds only what these need."""
        first = max(rows.start - self.top - self.margin, 0)
        last = min(rows.stop - self.top + self.margin, self.masked.mask.shape[0])
        level = replace(self.level, parts=(), table=None)  # needed only by estimates already made
        return replace(self, masked=self.masked.part(slice(first, last)), level=level, top=self.top + first)

    def __call__(self, block: Block) -> BlockResult:
        """Solves a block."""
        own = slice(block.rows.start - self.top, block.rows.stop - self.top)
        return _solve_block(self, own, block.chosen)


BlockMap = Callable[[BlockSolver, Sequence[Block]], Iterable[BlockResult]]
"""Applies a solver to blocks and returns the results in the order of the blocks, as `map` does."""


def noise_sample(count: int) -> np.ndarray:
    """Draws the numbers (K,), sorted, of the pixels among `count` that estimate the noise; the seed is fixed."""
    return np.sort(np.random.default_rng(1).permutation(count)[:SAMPLE_PIXELS])


@dataclass(frozen=True)
class SolvedSample:
    """Sample pixels (K) that lamps reach and that do not mix surfaces, the state there, and their solution."""

    pixels: Pixels
    state: AlternationResult
    solution: PixelSolution

    def solved_again(self, scene: Scene) -> PixelSolution:
        """Solves normals and albedo again in another scene; what pixels share stays as it is."""
        return _solve_pixels(self.pixels, self.state, scene)

    def fit(self, solution: PixelSolution, stated: image_values.Noise) -> Fit:
        """Returns the goodness of fit of a solution of the sample in the stated noise."""
        ray = self.pixels.ray
        low, high = ray.min(axis=1, keepdims=True), ray.max(axis=1, keepdims=True)
        place = ((ray - low) / np.maximum(high - low, 1e-9))[::-1]
        return goodness_of_fit.evaluate(solution.estimate, solution.values, stated, solution.extra_variance, place)


def with_residual_noise(sample: Pixels, state: AlternationResult, scene: Scene) -> tuple[Scene, SolvedSample]:
    """Estimates noise scales and median albedo from a sample at full resolution: the scene with them, and the solved
    sample without pixels that hardly any lamp reaches or that mix surfaces."""

    def step(noise: image_values.Noise) -> tuple[image_values.Noise, PixelSolution]:
        """Solves the sample with a noise model, and estimates the noise anew from the residuals."""
        solution = _solve_pixels(sample, state, replace(scene, noise=noise))
        estimated = residual_noise.estimate(
            solution.estimate, solution.values, noise, scene.noise, solution.extra_variance
        )
        return estimated, solution

    noise, solution = step(replace(scene.noise, intensity=state.noise.intensity, direction=state.noise.direction))
    left_out = solution.hardly_lit | (state.mixed > 0.5)
    if np.any(left_out):
        lit = np.flatnonzero(~left_out)
        sample, state = sample.subset(lit), state.resampled(lambda values: np.ascontiguousarray(values[..., lit]))
    noise, solution = step(noise)
    albedo = pixel_solve.median_albedo(solution.estimate, solution.measured, sample.clipped)
    solved = replace(scene, noise=noise, stated_noise=scene.noise, median_albedo=albedo)
    return solved, SolvedSample(sample, state, solution)


def solve(
    masked: MaskedImages, level: PyramidLevel, state: AlternationResult, scene: Scene, size: tuple[int, int],
    *, capture_sigma_deg: float = 0.0, sharpened: bool = False, block_map: BlockMap = map,
) -> NormalMap:  # fmt: skip
    """Solves all object pixels block by block, projects and integrates them; maps of the whole frame (H, W) of `size`.

    `state` is that of the level's coarse pixels; `scene` has the estimated lamps and noise. `capture_sigma_deg` is 1 σ
    of all normals due to the capture's findings; `sharpened`: the images were sharpened. `block_map` solves the blocks.
    """
    images, shape = masked.images, masked.mask.shape
    window = (images.rows, images.columns)
    maps = _empty_maps(size)
    surface = _integration_inputs(shape, discontinuous=bool(np.any(state.continuity_weight < 1)))
    flags = memory_mapped.zeros((len(images.lights), *size))
    equations = memory_mapped.zeros((*shape, 9), np.float32)
    views = {name: image[window] for name, image in maps.items()} | surface | {"equations": equations}
    samples = _stratified_sample(int(np.count_nonzero(masked.mask)))
    numbers: list[np.ndarray] = []
    matrices: list[FloatArray] = []
    light, indirect = 0.0, 0.0
    margin = 1 if state.indirect_irradiance is None else 3
    margin += 0 if scene.terms is None else term_solve.rounds(scene.terms) * margin
    blocks = _blocks(masked, samples)
    solved = block_map(BlockSolver(masked, level, state, scene, margin), blocks)
    for rows, block in zip((block.rows for block in blocks), solved, strict=True):
        mask = masked.mask[rows]
        for name, view in views.items():
            view[rows][mask] = block.maps[name]
        for image, values in zip(flags, block.flags, strict=True):
            image[window][rows][mask] = values
        light, indirect = light + block.light, indirect + block.indirect
        for stored in (flags, equations):
            memory_mapped.release(stored)
        numbers.append(np.flatnonzero(mask)[block.sampled] + rows.start * shape[1])
        matrices.append(block.matrices)
    del views
    noise_ratio = integrability.project_integrable(
        maps["normals"][window], maps["sigma_deg"][window], surface["variance"], masked.ray
    )
    regression_share = local_regression.regress(
        maps["normals"][window], maps["sigma_deg"][window], surface["variance"], noise_ratio
    )
    lights_used, stated_share = surface.pop("lights"), surface.pop("stated_share")
    facing = photometry.inside(masked.mask) & photometry.within_graded_slant(maps["normals"][window], masked.ray)
    errors = error_variance.evaluate(
        maps["sigma_deg"][window], maps["residual"][window], lights_used, stated_share, maps["normals"][window], facing,
        capture_deg=capture_sigma_deg, sharpened=sharpened,
    )  # fmt: skip
    # E of fewer than four lights is subtracted: images of an unchecked normal are not less informative.
    known_deg = np.square(errors.sigma_deg)
    known_deg[lights_used < photometry.OVERDETERMINED] -= photometry.SETTINGS.unchecked_sigma_deg**2
    np.sqrt(np.maximum(known_deg, np.square(maps["sigma_deg"][window]), out=known_deg), out=known_deg)
    maps["sigma_deg"][window] = errors.sigma_deg
    markov_field.regularise(maps["normals"][window], maps["albedo"][window], known_deg, equations, masked.ray)
    depth = integration.depth(
        maps["normals"][window].transpose(2, 0, 1), masked.mask, masked.ray,
        integration.confidence(surface.pop("variance")), surface.pop("start"),
        continuity_weight=surface.pop("continuity_weight", None), keep_steps=scene.settings.keep_steps,
    )  # fmt: skip
    unsolved = ~maps["mask"]
    maps["normals"][unsolved] = 0
    maps["depth"] = np.zeros(size, np.float32)
    maps["depth"][window] = depth
    maps["depth"][unsolved] = 0
    window_rows, window_columns = np.unravel_index(np.concatenate(numbers), shape)
    noise, terms = scene.noise, state.shared.terms
    strength, exponent = microfacet.blinn_phong(terms.gloss) if terms.gloss > 0 else (0.0, 0.0)
    return NormalMap(
        normals=maps["normals"],
        albedo=maps["albedo"],
        depth=maps["depth"],
        sigma_deg=maps["sigma_deg"],
        residual=maps["residual"],
        mask=maps["mask"],
        silhouette=maps["silhouette"],
        indirect=maps["indirect"],
        doubtful=maps["doubtful"],
        flags=flags,
        intensity_factors=np.exp(state.shared.log_intensity),
        information=FisherInformation(
            rows=window_rows.astype(np.int64) + images.rows.start,
            columns=window_columns.astype(np.int64) + images.columns.start,
            matrices=np.concatenate(matrices),
        ),
        noise={
            "intensity": noise.intensity,
            "direction": noise.direction,
            "shot": float(np.mean(noise.shot)),
            "misfit": errors.misfit,
            "structure_deg": errors.structure_deg,
            "regression_share": regression_share,
        },
        notes={
            "shift_m": state.shared.shift_m,
            "lamps_aside_m": state.shared.lamp_offset_m.tolist(),
            "threshold": scene.settings.shadow_threshold,
            "interreflection": {"share": indirect / light},
            "lobe": {
                "strength": float(terms.lobe_factor) * strength,
                "exponent": exponent,
                "dielectric": terms.strength == 0,
            },
        },
    )


def _empty_maps(size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Returns maps (H, W, ...) by name with their values outside the object."""
    maps: dict[str, np.ndarray] = {name: np.zeros(size, np.float32) for name in ("albedo", "residual", "indirect")}
    maps |= {name: np.zeros(size, np.bool_) for name in ("mask", "silhouette", "doubtful")}
    maps["normals"] = np.zeros((*size, 3), np.float32)
    maps["sigma_deg"] = np.full(size, np.nan, np.float32)
    return maps


def _integration_inputs(shape: tuple[int, int], *, discontinuous: bool) -> dict[str, np.ndarray]:
    """Returns the window's maps (h, w) that only projection, σ and integration need, with values outside the object."""
    maps: dict[str, np.ndarray] = {name: np.ones(shape, np.float32) for name in ("start", "stated_share")}
    maps |= {"variance": np.zeros(shape, np.float32), "lights": np.zeros(shape, np.uint8)}
    return maps | ({"continuity_weight": np.ones(shape, np.float32)} if discontinuous else {})


def _blocks(masked: MaskedImages, samples: np.ndarray) -> list[Block]:
    """Returns the blocks with object pixels; `samples` (K,), sorted, are the chosen pixels' numbers in the window."""
    found: list[Block] = []
    before = 0
    for rows in masked.blocks():
        after = before + int(np.count_nonzero(masked.mask[rows]))
        if after > before:
            chosen = samples[np.searchsorted(samples, before) : np.searchsorted(samples, after)] - before
            found.append(Block(rows, chosen))
        before = after
    return found


def _solve_block(solver: BlockSolver, rows: slice, chosen: np.ndarray) -> BlockResult:
    """Solves a block of rows of the solver's images with its margin on either side. The result has the Fisher
    information of those of its pixels `chosen` (K,) that are solved and that lamps reach."""
    masked, scene, margin = solver.masked, solver.scene, solver.margin
    read = slice(max(rows.start - margin, 0), min(rows.stop + margin, masked.mask.shape[0]))
    pixels = masked.pixels(read)
    local = solver.state.resampled(lambda values: solver.level.interpolate(values, pixels, solver.top + read.start))
    solution = _solve_pixels(pixels, local, scene)
    estimate, ray_direction = solution.estimate, photometry.ray_directions(pixels.ray)
    first = int(np.count_nonzero(masked.mask[read.start : rows.start]))
    own = slice(first, first + int(np.count_nonzero(masked.mask[rows])))

    used = np.count_nonzero(estimate.usable, axis=0)
    solved = used >= 2
    sigma = np.degrees(np.sqrt(solution.variance + local.shared_variance)).astype(np.float32)
    radiance = np.zeros_like(solution.measured) if solution.indirect is None else solution.indirect
    light, indirect = np.maximum(np.sum(solution.measured, axis=0), 1e-6), np.sum(radiance, axis=0)
    share = (indirect / light).astype(np.float32)
    maps = {
        "normals": pixel_solve.clamp_to_visible(estimate.normals, ray_direction).T,
        "albedo": np.where(solved, estimate.albedo, 0),
        "residual": np.where(solved, estimate.residual, 0),
        "indirect": np.where(solved, share, 0),
        "sigma_deg": np.where(solved, sigma, np.nan),
        "mask": solved,
        "silhouette": np.ones_like(solved),
        # With more than half indirect light the normal depends mainly on the prediction of that light.
        "doubtful": solved & ((used < 3) | (share > 0.5) | solution.hardly_lit),
        "variance": solution.variance,
        "start": local.depth_m,
        "continuity_weight": local.continuity_weight,
        "lights": np.minimum(used, 255).astype(np.uint8),
        "stated_share": _stated_share(solution, scene),
        "equations": pixel_solve.normal_equations(estimate, solution.values),
    }
    sampled = chosen[(solved & ~solution.hardly_lit)[own][chosen]]
    return BlockResult(
        maps={name: values[own] for name, values in maps.items()},
        flags=measurement_flags.classify(estimate, solution.measured, radiance, pixels.clipped, scene.noise)[:, own],
        light=float(np.sum(light[own], dtype=np.float64)),
        indirect=float(np.sum(indirect[own], dtype=np.float64)),
        sampled=sampled,
        matrices=pixel_solve.fisher_information(estimate, sampled + first, scene.lamps, ray_direction),
    )


def _stated_share(solution: PixelSolution, scene: Scene) -> Float32Array:
    """Mean ratio (N,) of stated to estimated variance, at most 1, over the usable measurements of each pixel."""
    estimate, usable = solution.estimate, solution.estimate.usable
    if scene.stated_noise is None:
        return np.ones(usable.shape[1], np.float32)
    strength = photometry.strength(estimate.light) * estimate.albedo
    stated, estimated = (
        noise.single_precision().variance(solution.values, strength) + solution.extra_variance
        for noise in (scene.stated_noise, scene.noise)
    )
    share = np.sum(np.minimum(stated / estimated, 1) * usable, axis=0) / np.maximum(np.count_nonzero(usable, axis=0), 1)
    return share.astype(np.float32)


def _solve_pixels(pixels: Pixels, state: AlternationResult, scene: Scene) -> PixelSolution:
    """Solves pixels by fixed-point iteration, because indirect light depends on the albedo."""
    pixels = replace(pixels, sky=state.sky)
    measured = alternation.divide_intensity(pixels.values, state.shared.log_intensity)
    lighting = Lighting.at(pixels, state.depth_m, scene)

    def once(values: Float32Array, extra: Float32Array | None, iterations: int) -> Estimate:
        return pixel_solve.solve_lit(pixels, values, lighting, scene, iterations=iterations, extra_variance=extra)

    values, extra, indirect, irradiance = measured, None, None, state.indirect_irradiance
    estimate = once(values, None, robust_solve.IRLS_ITERATIONS if irradiance is None else PRELIMINARY_ITERATIONS)
    if irradiance is not None:
        for iterations in (PRELIMINARY_ITERATIONS, robust_solve.IRLS_ITERATIONS):
            other = np.sum(np.broadcast_to(estimate.nondiffuse_value, values.shape), axis=0)
            indirect = interreflection.reflected_radiosity(
                irradiance, np.sum(measured, axis=0) - other, np.sum(values, axis=0) - other, estimate.albedo
            )
            values = measured - indirect
            extra = np.square(np.float32(photometry.SETTINGS.predicted_indirect_sigma) * indirect)
            estimate = once(values, extra, iterations)
    extra = np.zeros_like(measured) if extra is None else extra
    if estimate.terms is not None:
        extra = extra + estimate.terms.highlight_variance
    hardly_lit = alternation.hardly_lit(
        state.indirect_irradiance, measured, estimate, scene.terms, state.typical_albedo
    )
    return PixelSolution(estimate, measured, values, pixels.plus_extra(extra), indirect, hardly_lit)


def _stratified_sample(count: int) -> np.ndarray:
    """Draws a stratified sample of at most SAMPLE_PIXELS of `count` pixels, a random one of each run along the rows."""
    if count <= SAMPLE_PIXELS:
        return np.arange(count)
    edges = np.linspace(0, count, SAMPLE_PIXELS + 1)
    rng = np.random.default_rng(0)
    return np.minimum((edges[:-1] + rng.random(SAMPLE_PIXELS) * np.diff(edges)).astype(int), count - 1)
