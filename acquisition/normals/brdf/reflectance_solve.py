"""Solve with a reflectance of its own for each pixel: for materials that no model of the whole object fits.

Lambert's law and one lobe are far off on a metal of a broad lobe or on layers of gloss, but dozens of distant lights
determine the lobes of each pixel (`reflectance_fit`). Intensities are those stated, because those found with the wrong
model absorb its errors.
"""

from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED, NormalMap
from acquisition.normals.brdf import reflectance_fit
from acquisition.normals.images import memory_mapped
from acquisition.normals.images.normalised_images import Images, row_blocks

HIGHLIGHT_SHARE = 0.1
"""Share of the albedo by which a highlight exceeds the diffuse light; for the flags alone."""

SAMPLE_PIXELS = 400
"""Pixels that the shared form of the diffuse term is fitted to."""

UNKNOWN_VARIANCE_RAD2 = np.float32(np.radians(60.0) ** 2)
"""Upper bound of the variance, rad²: that of 60°."""


def solve(images: Images, directions: FloatArray, before: NormalMap) -> NormalMap:
    """Solves normals, albedo, σ and flags of the pixels of `before` by reflectance fits, under unit `directions`
    (F, 3). Blocks of rows are solved one after another."""
    table = reflectance_fit.light_table(directions)
    window = (images.rows, images.columns)
    mask = before.mask[window]
    normals = before.normals[window]
    values, clipped, lines, columns = _sample(images, mask)
    form = reflectance_fit.best_diffuse_form(values, clipped, table, normals[lines, columns])
    maps = {name: getattr(before, name).copy() for name in ("normals", "albedo", "sigma_deg", "residual")}
    variance = np.zeros(mask.shape, np.float32)
    flags = memory_mapped.zeros(before.flags.shape)
    for rows in row_blocks(len(mask)):
        chosen = np.flatnonzero(mask[rows])
        if len(chosen) == 0:
            continue
        values, clipped = _measurements(images, rows, chosen)
        fits = reflectance_fit.fit(values, clipped, table, form, normals[rows].reshape(-1, 3)[chosen])
        strength = np.sum(fits.strengths, axis=1)
        found = {
            "normals": fits.normals,
            # A pixel that is all gloss has a normal, too, although almost no diffuse albedo.
            "albedo": np.maximum(fits.strengths[:, 0], np.float32(1e-6) * strength),
            "residual": fits.spread,
        }
        inside = mask[rows]
        variance[rows][inside] = fits.variance
        for name, part in found.items():
            maps[name][window][rows][inside] = part
        diffuse = reflectance_fit.diffuse(fits.normals, table, form) * fits.strengths[:, :1]
        classified = _flags(values, clipped, diffuse, fits, directions)
        for image, one in zip(flags, classified, strict=True):
            image[window][rows][inside] = one
        memory_mapped.release(flags)
    # Ambiguity between lobes and diffuse term, and penumbrae, show in deviations from the neighbours, if at all. Noise
    # shows there as well as in the residuals, so that the larger of the two variances covers both.
    apart = reflectance_fit.neighbour_deviation(maps["normals"][window][mask], np.flatnonzero(mask), mask.shape[1])
    total = np.maximum(variance[mask], apart**2) + np.float32(photometry.SETTINGS.flat_field_sigma**2)
    maps["sigma_deg"][window][mask] = np.degrees(np.sqrt(np.minimum(total, UNKNOWN_VARIANCE_RAD2)))
    why = "no single reflectance fits the whole object: each pixel is fitted with its own specular lobes"
    return replace(
        before, **maps, flags=flags, intensity_factors=np.ones(len(directions)),
        notes=before.notes | {"why": why, "diffuse_form": {"kappa": float(form[0]), "omega": float(form[1])}},
    )  # fmt: skip


def _measurements(images: Images, rows: slice, chosen: np.ndarray) -> tuple[Float32Array, BoolArray]:
    """Returns values and clipped measurements (K, F) at pixels of rows of the window, by their numbers."""
    block = images.read(rows.start, rows.stop)
    values = block.values.reshape(len(block.values), -1)[:, chosen].T
    clipped = block.clipped.reshape(len(block.clipped), -1)[:, chosen].T
    return np.ascontiguousarray(values, np.float32), np.ascontiguousarray(clipped)


def _sample(images: Images, mask: BoolArray) -> tuple[Float32Array, BoolArray, np.ndarray, np.ndarray]:
    """Returns values and clipped measurements (K, F) of about `SAMPLE_PIXELS` pixels, and their rows and columns (K,).
    The pixels are on evenly spread rows."""
    lines = np.flatnonzero(np.any(mask, axis=1))
    lines = lines[np.linspace(0, len(lines) - 1, min(len(lines), 48)).astype(int)]
    rng = np.random.default_rng(0)
    share = -(-SAMPLE_PIXELS // len(lines))
    columns = [np.sort(rng.permutation(np.flatnonzero(mask[line]))[:share]) for line in lines]
    parts = [
        _measurements(images, slice(line, line + 1), some) for line, some in zip(lines.tolist(), columns, strict=True)
    ]
    values, clipped = (np.concatenate(both) for both in zip(*parts, strict=True))
    return values, clipped, np.repeat(lines, [len(some) for some in columns]), np.concatenate(columns)


def _flags(
    values: Float32Array, clipped: BoolArray, diffuse: Float32Array, fits: reflectance_fit.ReflectanceFits,
    directions: FloatArray,
) -> np.ndarray:  # fmt: skip
    """Returns the flags (F, K) as in `models.result`; the sign of n·l distinguishes attached from cast shadows."""
    lit = reflectance_fit.usable(values, clipped)
    highlight = lit & (values > diffuse + HIGHLIGHT_SHARE * (diffuse + fits.strengths[:, :1]))
    dark = np.where(fits.normals @ directions.T < 0, ATTACHED, CAST)
    flags = np.where(clipped, SATURATED, np.where(highlight, LIT | HIGHLIGHT, np.where(lit, LIT, dark)))
    return flags.T.astype(np.uint8)
