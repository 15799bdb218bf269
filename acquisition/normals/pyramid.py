"""The object's pixels, one block of rows after another, so that no more of the images is ever held.

What a coarse grid and a sample of pixels want of the images is gathered in one look at them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration
from acquisition.normals import resampling, silhouette
from acquisition.normals.interreflection import Table
from acquisition.normals.pixel_solve import Pixels
from acquisition.normals.session_images import Images

BLOCK_VALUES = 1 << 22
"""Values of all images in a block; the last solve takes about ninety bytes for each."""

MIN_BLOCK_ROWS = 16
"""Rows of a block at least: some above and below are read and solved with it, for its own pixels' sake."""


@dataclass(frozen=True)
class MaskedImages:
    """The object in the images' window: where it is (h, w), and each pixel's ray (2, h, w)."""

    images: Images
    mask: BoolArray
    ray: Float32Array

    def blocks(self, multiple: int = 1) -> Iterator[slice]:
        """All rows of the window in blocks, each but the last of a multiple of so many rows."""
        height, width = self.mask.shape
        rows = max(MIN_BLOCK_ROWS, BLOCK_VALUES // (len(self.images.lights) * width))
        step = -(-rows // multiple) * multiple
        return (slice(start, min(start + step, height)) for start in range(0, height, step))

    def pixels(self, rows: slice) -> Pixels:
        """The object's pixels in some rows."""
        return self._pixels(rows, *self.images.read(rows.start, rows.stop))

    def _pixels(self, rows: slice, values: Float32Array, clipped: BoolArray) -> Pixels:
        mask, count = self.mask[rows], len(values)
        index = np.flatnonzero(mask)
        return Pixels(
            shape=(mask.shape[0], mask.shape[1]),
            index=index,
            ray=np.ascontiguousarray(self.ray[:, rows].reshape(2, -1)[:, index]),
            values=np.ascontiguousarray(values.reshape(count, -1)[:, index]),
            clipped=clipped.reshape(count, -1)[:, index],
        )

    def level(self, factor: int, chosen: np.ndarray, table_depth_m: Float32Array | None) -> "PyramidLevel":
        """The object on a grid `factor` times coarser, and the pixels with the numbers `chosen` (K,), sorted.

        `table_depth_m` (h, w) is the depth of what surrounds the object, none: nothing does.
        """
        coarse: list[Pixels] = []
        few: list[tuple[int, Pixels]] = []
        around: list[Float32Array] = []
        before = 0
        for rows in self.blocks(factor):
            values, clipped = self.images.read(rows.start, rows.stop)
            pixels = self._pixels(rows, values, clipped)
            after = before + len(pixels.index)
            inside = chosen[np.searchsorted(chosen, before) : np.searchsorted(chosen, after)]
            few.append((rows.start, pixels.subset(inside - before)))
            coarse.append(resampling.coarsen(pixels, factor))
            if table_depth_m is not None:
                around.append(resampling.block_means(values, factor))
            before = after
        table = None
        if table_depth_m is not None:
            table = Table(resampling.block_means(table_depth_m, factor), np.concatenate(around, axis=1))
        return PyramidLevel(resampling.concatenate_rows(coarse), factor, tuple(few), table)


@dataclass(frozen=True)
class PyramidLevel:
    """The object on a coarse grid, what is around it or none, and some of its pixels, each part with its first row."""

    coarse: Pixels
    factor: int
    parts: tuple[tuple[int, Pixels], ...]
    table: Table | None

    @property
    def sample(self) -> Pixels:
        """The chosen pixels in the window."""
        return resampling.concatenate_rows([part for _, part in self.parts])

    def interpolate(self, values: Float32Array, pixels: Pixels, top: int) -> Float32Array:
        """Values (..., M) of the coarse grid at pixels (..., N) of a window that begins at the row `top`."""
        return resampling.interpolate(values, self.coarse, self.factor, pixels, top)

    def interpolate_sample(self, values: Float32Array) -> Float32Array:
        """Values (..., M) of the coarse grid at the chosen pixels (..., K)."""
        return np.concatenate([self.interpolate(values, part, top) for top, part in self.parts], axis=-1)


def albedo_bound(
    seen: MaskedImages, depth_m: Float32Array, lamp: Float32Array, calibration: Calibration
) -> Float32Array:
    """`silhouette.brightest` (h, w) of all rows, on a plane at depth (h, w)."""
    out = np.empty(seen.mask.shape, np.float32)
    for rows in seen.blocks():
        values, clipped = seen.images.read(rows.start, rows.stop)
        point = photometry.points(seen.ray[:, rows], depth_m[rows]).reshape(3, -1)
        light = photometry.light_vectors(point, lamp, calibration)
        strength = np.sqrt(np.einsum("fcn,fcn->fn", light, light)).reshape(values.shape)
        out[rows] = silhouette.albedo_bound(values, strength, clipped)
    return out
