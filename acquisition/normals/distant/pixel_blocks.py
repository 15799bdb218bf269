"""Blocks of rows of an image set as planar stacks (F, N) of one brightness per pixel, from any stored type.

Grey images pass in the type they are stored in, without a copy beyond the reader's. Colours are divided by the light's
intensity channel by channel and mixed to one grey: by fixed weights where figures are to be compared (the luma of ITU-R
BT.601, as the field's plain least squares uses), else by the pixel's own colour, which is the best unbiased mix for a
diffuse surface and lets coloured paint outweigh its white gloss; channels of faint light count less.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.distant import grey_conversion
from acquisition.normals.image_set import DistantLights, ImageSet

LUMA = np.array([0.2989, 0.5870, 0.1140], np.float32)
"""Weights of R, G, B: luma of ITU-R BT.601."""


@dataclass(frozen=True)
class ChannelSettings:
    """Tuned numbers of the mean of channels."""

    dim_channel_share: float = tuned(0.25, "share")
    """Share of the strongest channel's intensity at which a channel's weight falls to a half: divided by its intensity,
    a fainter channel is mostly noise."""


SETTINGS = ChannelSettings()

BLOCK_BYTES = 8_000_000
"""Bytes of stored values in one block; solvers' intermediates take five to ten times as much."""


@dataclass(frozen=True)
class Block:
    """Rows [start, stop) as `stack` (F, N) stored values; times `scale` (F,) they are brightness per unit of light.

    `clipped_from` is the stored value from which a measurement is clipped; `colour` (N, 3) the ratio of each channel's
    brightness to the mix, none for grey images.
    """

    start: int
    stop: int
    stack: np.ndarray
    scale: Float32Array
    clipped_from: float
    colour: Float32Array | None

    def pixels(self, chosen: np.ndarray) -> tuple[Float32Array, BoolArray]:
        """Brightness and clipping mask, both (K, F), of the pixels with the numbers `chosen` (K,)."""
        picked = self.stack[:, chosen]
        values = picked.T.astype(np.float32) * self.scale
        clipped = picked >= self.clipped_from
        return np.ascontiguousarray(values), np.ascontiguousarray(clipped.T)


def directions(images: ImageSet) -> FloatArray:
    """Unit light directions (F, 3)."""
    lights = _distant(images)
    return lights.directions / np.linalg.norm(lights.directions, axis=1, keepdims=True)


def _distant(images: ImageSet) -> DistantLights:
    assert isinstance(images.lights, DistantLights)  # noqa: S101 - `solve` has refused anything else
    return images.lights


def intensities(images: ImageSet) -> FloatArray:
    """Intensity (F, C) that fractions of full scale are divided by."""
    return _distant(images).intensities


def rows_at_once(images: ImageSet) -> int:
    """Number of rows of one block, such that its stored values stay below BLOCK_BYTES."""
    size = 2 if images.channels == 1 else 4 * 4
    return max(1, min(images.height, BLOCK_BYTES // (images.count * images.width * size)))


def read(images: ImageSet, start: int, stop: int, *, luma: bool) -> Block:
    """Reads the rows [start, stop) as one block; `luma` mixes colours by the fixed weights LUMA."""
    strength = intensities(images)
    size = (stop - start) * images.width
    first = images.rows(0, start, stop)
    # The kernels take sixteen bits; eight are widened.
    kind = np.uint16 if first.dtype == np.uint8 else first.dtype
    stored = np.empty((images.count, *first.shape), kind)
    stored[0] = first
    for image in range(1, images.count):
        stored[image] = images.rows(image, start, stop)
    gain = (1.0 / (images.full_scale * strength)).astype(np.float32)
    clipped_from = images.saturated_from * images.full_scale
    if images.channels == 1:
        return Block(start, stop, stored.reshape(images.count, size), gain[:, 0].copy(), clipped_from, None)
    stack, tint = np.empty((images.count, size), np.float32), np.empty((size, 3), np.float32)
    grey_conversion.mix(
        stored.reshape(images.count, size, 3), gain, clipped_from, LUMA, _channel_weights(strength), luma, stack, tint
    )
    return Block(start, stop, stack, np.ones(images.count, np.float32), grey_conversion.CLIPPED_VALUE / 2, tint)


def _channel_weights(strength: FloatArray) -> Float32Array:
    """Weight (C,) of each channel, 0–1, for light intensities `strength` (F, C): s²/(s² + DIM_CHANNEL_SHARE²)."""
    share = np.mean(strength, axis=0) / np.max(np.mean(strength, axis=0))
    return (share**2 / (share**2 + SETTINGS.dim_channel_share**2)).astype(np.float32)


def iterate(images: ImageSet, *, luma: bool) -> Iterator[Block]:
    """Iterates over the blocks that hold pixels of the mask."""
    step = rows_at_once(images)
    for start in range(0, images.height, step):
        stop = min(start + step, images.height)
        if np.any(images.mask[start:stop]):
            yield read(images, start, stop, luma=luma)


def sample(images: ImageSet, count: int) -> tuple[Float32Array, BoolArray]:
    """Samples about `count` pixels of the mask, from evenly spread rows: brightness and clipping mask, both (K, F)."""
    values: list[Float32Array] = []
    clipped: list[BoolArray] = []
    for row, columns in _sampled(images.mask, count):
        picked, full = read(images, row, row + 1, luma=False).pixels(columns)
        values.append(picked)
        clipped.append(full)
    return np.concatenate(values), np.concatenate(clipped)


def sample_channels(images: ImageSet, count: int) -> tuple[Float32Array, BoolArray]:
    """The same pixels channel by channel: brightness and clipping mask, both (C, K, F)."""
    gain = 1.0 / intensities(images)
    values: list[Float32Array] = []
    for row, columns in _sampled(images.mask, count):
        rows = [images.values(image, row, row + 1)[0, columns] for image in range(images.count)]
        values.append(np.stack(rows).reshape(images.count, len(columns), images.channels))
    stack = np.concatenate(values, axis=1)  # (F, K, C) fractions of full scale
    brightness = (stack * gain[:, None, : images.channels]).astype(np.float32)
    return (
        np.ascontiguousarray(brightness.transpose(2, 1, 0)),
        np.ascontiguousarray((stack >= images.saturated_from).transpose(2, 1, 0)),
    )


def _sampled(mask: BoolArray, count: int) -> Iterator[tuple[int, np.ndarray]]:
    """Rows and columns of about `count` pixels of the mask, from evenly spread rows."""
    rng = np.random.default_rng(0)
    object_rows = np.flatnonzero(np.any(mask, axis=1))
    rows = np.unique(object_rows[np.linspace(0, len(object_rows) - 1, min(len(object_rows), 48)).astype(int)])
    share = -(-count // len(rows))
    for row in rows:
        yield int(row), np.sort(rng.permutation(np.flatnonzero(mask[row]))[:share])
