"""Solve at full resolution, block of rows by block of rows, in any process.

A pixel depends on its neighbours only through which of them are in shadow, and this reaches one row further with each
solve after light is subtracted. With a margin of as many rows on either side, a block gets the same result as all rows
together. A pixel with fewer than two usable lights gets no normal. With two lights the prior determines the normal
along one direction, and σ is accordingly large.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.normals import pixel_solution
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.pixel_solution import PixelSolution
from acquisition.normals.pixels import measurement_flags, pixel_solve, term_solve
from acquisition.normals.pixels.pixel_solve import Scene
from acquisition.normals.pyramid import MaskedImages, PyramidLevel

INFORMATION_PIXELS = 4000
"""Pixels at most whose Fisher information the planner gets."""


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

    @classmethod
    def of(cls, masked: MaskedImages, level: PyramidLevel, state: AlternationResult, scene: Scene) -> "BlockSolver":
        """Returns the solver of a whole window, with the margin that the solves of a pixel need."""
        margin = 1 if state.indirect_irradiance is None else 3
        margin += 0 if scene.terms is None else term_solve.rounds(scene.terms) * margin
        return cls(masked, level, state, scene, margin)

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


def blocks(masked: MaskedImages) -> list[Block]:
    """Returns the blocks with object pixels, with at most INFORMATION_PIXELS chosen pixels in all."""
    samples = _stratified_sample(int(np.count_nonzero(masked.mask)))
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
    solution = pixel_solution.solve_pixels(pixels, local, scene)
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


def _stratified_sample(count: int) -> np.ndarray:
    """Draws a stratified sample of at most INFORMATION_PIXELS of `count` pixels: a random one of each run."""
    if count <= INFORMATION_PIXELS:
        return np.arange(count)
    edges = np.linspace(0, count, INFORMATION_PIXELS + 1)
    rng = np.random.default_rng(0)
    return np.minimum((edges[:-1] + rng.random(INFORMATION_PIXELS) * np.diff(edges)).astype(int), count - 1)
