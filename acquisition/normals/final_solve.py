"""Final solve at full resolution: every pixel once, then the surface as a whole: normals, σ and depth.

Pixels are solved in blocks of rows (`block_solve`). Then the normals are projected onto those of an integrable surface
and regressed on their neighbours, σ is evaluated with the components of the model's error, uncertain normals are
regularised by a Markov random field, and depth is integrated. Each of these steps changes the maps in place, because
those of a large image take most of the memory.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.models.base import FloatArray
from acquisition.models.result import FisherInformation, NormalMap
from acquisition.normals import block_solve
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.block_solve import Block, BlockMap, BlockResult, BlockSolver
from acquisition.normals.images import memory_mapped
from acquisition.normals.pixels import microfacet
from acquisition.normals.pixels.image_terms import ImageTerms
from acquisition.normals.pixels.pixel_solve import Scene
from acquisition.normals.pyramid import MaskedImages, PyramidLevel
from acquisition.normals.surface import integrability, integration, local_regression, markov_field
from acquisition.normals.uncertainty import error_variance
from acquisition.normals.uncertainty.error_variance import ErrorVariance


def solve(
    masked: MaskedImages, level: PyramidLevel, state: AlternationResult, scene: Scene, size: tuple[int, int],
    *, capture_sigma_deg: float = 0.0, sharpened: bool = False, block_map: BlockMap = map,
) -> NormalMap:  # fmt: skip
    """Solves all object pixels block by block, projects and integrates them; maps of the whole frame (H, W) of `size`.

    `state` is that of the level's coarse pixels; `scene` has the estimated lamps and noise. `capture_sigma_deg` is 1 σ
    of all normals due to the capture's findings; `sharpened`: the images were sharpened. `block_map` solves the blocks.
    """
    window, shape = (masked.images.rows, masked.images.columns), masked.mask.shape
    maps = _empty_maps(size)
    surface = _surface_maps(shape, discontinuous=bool(np.any(state.continuity_weight < 1)))
    flags = memory_mapped.zeros((len(masked.images.lights), *size))
    views = {name: image[window] for name, image in maps.items()}
    blocks = block_solve.blocks(masked)
    solved = _gather(
        zip(blocks, block_map(BlockSolver.of(masked, level, state, scene), blocks), strict=True),
        masked, views | surface, flags[:, *window],
    )  # fmt: skip
    refined = _refine(views, surface, masked, capture_sigma_deg=capture_sigma_deg, sharpened=sharpened)
    depth = integration.depth(
        views["normals"].transpose(2, 0, 1), masked.mask, masked.ray,
        integration.confidence(surface.pop("variance")), surface.pop("start"),
        continuity_weight=surface.pop("continuity_weight", None), keep_steps=scene.settings.keep_steps,
    )  # fmt: skip
    maps["depth"] = np.zeros(size, np.float32)
    maps["depth"][window] = depth
    for name in ("normals", "depth"):
        maps[name][~maps["mask"]] = 0
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
            rows=solved.rows + masked.images.rows.start,
            columns=solved.columns + masked.images.columns.start,
            matrices=solved.matrices,
        ),
        noise={
            "intensity": scene.noise.intensity,
            "direction": scene.noise.direction,
            "shot": float(np.mean(scene.noise.shot)),
            "misfit": refined.errors.misfit,
            "structure_deg": refined.errors.structure_deg,
            "regression_share": refined.regression_share,
        },
        notes={
            "shift_m": state.shared.shift_m,
            "lamps_aside_m": state.shared.lamp_offset_m.tolist(),
            "threshold": scene.settings.shadow_threshold,
            "interreflection": {"share": solved.indirect_share},
            "lobe": _lobe(state.shared.terms),
        },
    )


def _empty_maps(size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Returns maps (H, W, ...) by name with their values outside the object."""
    maps: dict[str, np.ndarray] = {name: np.zeros(size, np.float32) for name in ("albedo", "residual", "indirect")}
    maps |= {name: np.zeros(size, np.bool_) for name in ("mask", "silhouette", "doubtful")}
    maps["normals"] = np.zeros((*size, 3), np.float32)
    maps["sigma_deg"] = np.full(size, np.nan, np.float32)
    return maps


def _surface_maps(shape: tuple[int, int], *, discontinuous: bool) -> dict[str, np.ndarray]:
    """Returns the window's maps (h, w, ...) that only later steps need, with their values outside the object."""
    maps: dict[str, np.ndarray] = {name: np.ones(shape, np.float32) for name in ("start", "stated_share")}
    maps |= {"variance": np.zeros(shape, np.float32), "lights": np.zeros(shape, np.uint8)}
    maps["equations"] = memory_mapped.zeros((*shape, 9), np.float32)
    return maps | ({"continuity_weight": np.ones(shape, np.float32)} if discontinuous else {})


@dataclass(frozen=True)
class _Gathered:
    """What the blocks have beside maps: rows and columns (K,) in the window and Fisher information (K, 4, 4) of the
    chosen pixels, and the share of the light that is indirect."""

    rows: np.ndarray
    columns: np.ndarray
    matrices: FloatArray
    indirect_share: float


def _gather(
    solved: Iterable[tuple[Block, BlockResult]], masked: MaskedImages, maps: dict[str, np.ndarray], flags: np.ndarray
) -> _Gathered:
    """Writes the blocks' results into the window's maps (h, w, ...) and flags (F, h, w), and gathers the rest."""
    numbers: list[np.ndarray] = []
    matrices: list[FloatArray] = []
    light, indirect = 0.0, 0.0
    for block, result in solved:
        mask = masked.mask[block.rows]
        for name, view in maps.items():
            view[block.rows][mask] = result.maps[name]
        for image, values in zip(flags, result.flags, strict=True):
            image[block.rows][mask] = values
        light, indirect = light + result.light, indirect + result.indirect
        for stored in (flags, maps["equations"]):
            memory_mapped.release(stored)
        numbers.append(np.flatnonzero(mask)[result.sampled] + block.rows.start * mask.shape[1])
        matrices.append(result.matrices)
    rows, columns = np.unravel_index(np.concatenate(numbers).astype(np.int64), masked.mask.shape)
    return _Gathered(rows, columns, np.concatenate(matrices), indirect / light)


@dataclass(frozen=True)
class _Refined:
    """What the refinement of the surface says of errors: their components, and how far normals went to neighbours'."""

    errors: ErrorVariance
    regression_share: float


def _refine(
    maps: dict[str, np.ndarray], surface: dict[str, np.ndarray], masked: MaskedImages, *, capture_sigma_deg: float,
    sharpened: bool,
) -> _Refined:  # fmt: skip
    """Refines the window's normals, σ and albedo in place: projection onto integrable normals, regression on
    neighbours, components of σ, regularisation of uncertain normals. Takes out of `surface` what no later step needs.
    """
    normals, sigma_deg = maps["normals"], maps["sigma_deg"]
    noise_ratio = integrability.project_integrable(normals, sigma_deg, surface["variance"], masked.ray)
    regression_share = local_regression.regress(normals, sigma_deg, surface["variance"], noise_ratio)
    lights, stated_share = surface.pop("lights"), surface.pop("stated_share")
    facing = photometry.inside(masked.mask) & photometry.within_graded_slant(normals, masked.ray)
    errors = error_variance.evaluate(
        sigma_deg, maps["residual"], lights, stated_share, normals, facing, capture_deg=capture_sigma_deg,
        sharpened=sharpened,
    )  # fmt: skip
    # E of the capture and of fewer than four lights is subtracted: pixels share it, or nothing checks it, but it makes
    # the images no less informative.
    known_deg = np.square(errors.sigma_deg)
    known_deg -= np.float32(capture_sigma_deg**2)
    known_deg[lights < photometry.OVERDETERMINED] -= photometry.SETTINGS.unchecked_sigma_deg**2
    np.sqrt(np.maximum(known_deg, np.square(sigma_deg), out=known_deg), out=known_deg)
    sigma_deg[:] = errors.sigma_deg
    markov_field.regularise(normals, maps["albedo"], sigma_deg, known_deg, surface.pop("equations"), masked.ray)
    return _Refined(errors, regression_share)


def _lobe(terms: ImageTerms) -> dict[str, float | bool]:
    """Returns the specular lobe as Blinn and Phong's, for relighting; strength 0: there is none."""
    strength, exponent = microfacet.blinn_phong(terms.gloss) if terms.gloss > 0 else (0.0, 0.0)
    return {
        "strength": float(terms.lobe_factor) * strength,
        "exponent": exponent,
        "dielectric": terms.strength == 0,
    }
