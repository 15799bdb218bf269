"""Masked images of a window in blocks of rows, and the coarse level of their pyramid.

One block of rows is processed at a time. One pass over the images gathers the coarse grid and a sample of pixels.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from acquisition import mosaic, photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration
from acquisition.mosaic import Sites
from acquisition.normals.images.normalised_images import ImageBlock, Images
from acquisition.normals.indirect_light.interreflection import Table
from acquisition.normals.pixels import resampling
from acquisition.normals.pixels.pixel_solve import Pixels

BLOCK_VALUES = 1 << 22
"""Number of values of all images in a block; the final solve takes about ninety bytes for each."""

MIN_BLOCK_ROWS = 16
"""Least number of rows of a block, because a margin above and below is read and solved with each block."""


@dataclass(frozen=True)
class MaskedImages:
    """Images with the object's mask (h, w) in their window, each pixel's ray (2, h, w), X/Z and Y/Z, and, for a mosaic
    sensor only, the channel (h, w) of each site."""

    images: Images
    mask: BoolArray
    ray: Float32Array
    channel: Sites | None = None

    def blocks(self, multiple: int = 1) -> Iterator[slice]:
        """Partitions the window's rows into blocks; each but the last is a `multiple` of rows."""
        height, width = self.mask.shape
        rows = max(MIN_BLOCK_ROWS, BLOCK_VALUES // (len(self.images.lights) * width))
        step = -(-rows // multiple) * multiple
        return (slice(start, min(start + step, height)) for start in range(0, height, step))

    def part(self, rows: slice) -> "MaskedImages":
        """Returns some rows as a window of their own, whose images are read through the whole window's reader."""
        whole, channel = self.images, None if self.channel is None else self.channel[rows]

        def read(start: int, stop: int) -> ImageBlock:
            return whole.read(rows.start + start, rows.start + stop)

        inside = slice(whole.rows.start + rows.start, whole.rows.start + rows.stop)
        return MaskedImages(replace(whole, read=read, rows=inside), self.mask[rows], self.ray[:, rows], channel)

    def pixels(self, rows: slice) -> Pixels:
        """Reads the object's pixels in a block of rows."""
        return self._pixels(rows, self.images.read(rows.start, rows.stop))

    def _pixels(self, rows: slice, block: ImageBlock) -> Pixels:
        mask, count = self.mask[rows], len(block.values)
        index = np.flatnonzero(mask)
        return Pixels(
            shape=(mask.shape[0], mask.shape[1]),
            index=index,
            ray=np.take(self.ray[:, rows].reshape(2, -1), index, axis=1),
            values=np.take(block.values.reshape(count, -1), index, axis=1),
            clipped=np.take(block.clipped.reshape(count, -1), index, axis=1),
            extra=None if block.extra is None else np.take(block.extra.reshape(count, -1), index, axis=1),
            channel=None if self.channel is None else self.channel[rows].ravel()[index],
        )

    def level(self, factor: int, chosen: np.ndarray, table_depth_m: Float32Array | None) -> "PyramidLevel":
        """Returns block means on a grid `factor` times coarser, and the pixels with the numbers `chosen` (K,), sorted.

        `table_depth_m` is the depth of the object's surroundings on that grid; none: there are no surroundings.
        """
        coarse: list[Pixels] = []
        sample: list[tuple[int, Pixels]] = []
        table_values: list[Float32Array] = []
        before = 0
        for rows in self.blocks(factor):
            block = self.images.read(rows.start, rows.stop)
            pixels = self._pixels(rows, block)
            after = before + len(pixels.index)
            inside = chosen[np.searchsorted(chosen, before) : np.searchsorted(chosen, after)]
            sample.append((rows.start, pixels.subset(inside - before)))
            coarse.append(resampling.coarsen(pixels, factor))
            if table_depth_m is not None:
                table_values.append(resampling.block_means(block.values, factor))
            before = after
        table = None
        if table_depth_m is not None:
            table = Table(table_depth_m, np.concatenate(table_values, axis=1))
        return PyramidLevel(resampling.concatenate_rows(coarse), factor, tuple(sample), table)


@dataclass(frozen=True)
class PyramidLevel:
    """Block means of the object (`coarse`) and of its surroundings, if any (`table`), and a sample of full-resolution
    pixels (`parts`, those of each block with the block's first row)."""

    coarse: Pixels
    factor: int
    parts: tuple[tuple[int, Pixels], ...]
    table: Table | None

    @property
    def sample(self) -> Pixels:
        """The sample pixels of the whole window."""
        return resampling.concatenate_rows([part for _, part in self.parts])

    def interpolate(self, values: Float32Array, pixels: Pixels, top: int) -> Float32Array:
        """Interpolates coarse values (..., M) bilinearly at pixels (..., N) of a window whose first row is `top`."""
        return resampling.interpolate(values, self.coarse, self.factor, pixels, top)

    def interpolate_sample(self, values: Float32Array) -> Float32Array:
        """Interpolates coarse values (..., M) bilinearly at the sample pixels (..., K)."""
        return np.concatenate([self.interpolate(values, part, top) for top, part in self.parts], axis=-1)


def albedo_bound(
    masked: MaskedImages, depth_m: Float32Array, lamps: Float32Array, calibration: Calibration
) -> Float32Array:
    """Returns a lower bound of the albedo (h, w) of a surface at depth (h, w): each pixel's largest value as a share of
    a white surface's, infinite if one is clipped. Of a mosaic it is the least mean of its 2 × 2 cells."""
    out = np.empty(masked.mask.shape, np.float32)
    for rows in masked.blocks():
        values, clipped, _ = masked.images.read(rows.start, rows.stop)
        point = photometry.points(masked.ray[:, rows], depth_m[rows]).reshape(3, -1)
        light = photometry.light_vectors(point, lamps, calibration)
        strength = photometry.strength(light).reshape(values.shape)
        out[rows] = np.max(np.where(clipped, np.inf, values / np.maximum(strength, 1e-6)), axis=0)
    return out if masked.channel is None else mosaic.least_cell_mean(out)
