"""Resampling between the full grid of pixels and a coarse one: block means down, bilinear interpolation up.

Only object pixels enter the means. Values are extrapolated over the object's border before interpolation, so that the
table's never mix in.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from acquisition.models.base import Float32Array
from acquisition.normals.pixels.pixel_solve import Pixels

EXTRAPOLATION_PX = 5
"""Width of the box, coarse pixels, whose mean extrapolates values over the border."""


def coarsen(pixels: Pixels, factor: int) -> Pixels:
    """Returns block means over factor × factor pixels, of object pixels only; a block with a clipped pixel is clipped.
    Blocks larger than a pixel have no channel, because in a mosaic they hold all channels."""
    if factor == 1:
        return pixels
    index, number = np.unique(_blocks(pixels, factor), return_inverse=True)
    extra = None
    if pixels.extra is not None:
        extra = (_means(pixels.extra, number) * (1.0 / np.bincount(number))).astype(np.float32)
    return replace(
        pixels,
        shape=(-(-pixels.shape[0] // factor), -(-pixels.shape[1] // factor)),
        index=index,
        ray=_means(pixels.ray, number).astype(np.float32),
        values=_means(pixels.values, number).astype(np.float32),
        clipped=_means(pixels.clipped, number) > 0,
        channel=None,
        extra=extra,
    )


def coarsen_values(values: Float32Array, pixels: Pixels, factor: int) -> Float32Array:
    """Returns block means (..., M) of values (..., N) at the pixels, in the order of `coarsen`."""
    return _means(values, np.unique(_blocks(pixels, factor), return_inverse=True)[1]).astype(np.float32)


def _blocks(pixels: Pixels, factor: int) -> np.ndarray:
    """Flat index (N,) in the coarse grid of each pixel's block."""
    row, column = np.unravel_index(pixels.index, pixels.shape)
    return (row // factor) * -(-pixels.shape[1] // factor) + column // factor


def _means(values: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Means (..., M) of the values (..., N) that have each of the numbers (N,), 0 to M − 1."""
    share = 1.0 / np.bincount(number)
    means = [np.bincount(number, one) * share for one in values.reshape(math.prod(values.shape[:-1]), len(number))]
    return np.reshape(means, (*values.shape[:-1], len(share)))


def block_means(image: Float32Array, factor: int) -> Float32Array:
    """Block means of an image (..., h, w); blocks that reach over the border repeat its last pixels."""
    rows, columns = -image.shape[-2] % factor, -image.shape[-1] % factor
    padded = np.pad(image, [(0, 0)] * (image.ndim - 2) + [(0, rows), (0, columns)], mode="edge")
    height, width = padded.shape[-2] // factor, padded.shape[-1] // factor
    return padded.reshape(*image.shape[:-2], height, factor, width, factor).mean(axis=(-3, -1))


def concatenate_rows(parts: Sequence[Pixels]) -> Pixels:
    """Concatenates the pixels of windows that lie one below the other into those of their union."""
    above = np.cumsum([0, *(part.shape[0] for part in parts)])
    width = parts[0].shape[1]
    channels = [part.channel for part in parts if part.channel is not None]
    extras = [part.extra for part in parts if part.extra is not None]
    return Pixels(
        shape=(int(above[-1]), width),
        index=np.concatenate([part.index + width * top for part, top in zip(parts, above[:-1], strict=True)]),
        ray=np.concatenate([part.ray for part in parts], axis=1),
        values=np.concatenate([part.values for part in parts], axis=1),
        clipped=np.concatenate([part.clipped for part in parts], axis=1),
        channel=np.concatenate(channels) if channels else None,
        extra=np.concatenate(extras, axis=1) if extras else None,
    )


def interpolate(values: Float32Array, coarse: Pixels, factor: int, pixels: Pixels, top: int = 0) -> Float32Array:
    """Bilinear interpolation of values (..., M) at coarse pixels to full-resolution pixels (..., N).

    The window of `pixels` begins `top` rows below that of `coarse`.
    """
    weight = coarse.image(np.ones(len(coarse.index), np.float32))
    around = cv2.blur(weight, (EXTRAPOLATION_PX, EXTRAPOLATION_PX))
    height, width = coarse.shape
    rows, columns = pixels.shape
    # With one more coarse row on either side, the rows that are left out do not change the interpolation.
    first, last = max(top // factor - 1, 0), min(-(-(top + rows) // factor) + 1, height)
    size, skipped = (width * factor, (last - first) * factor), top - first * factor
    out = np.empty((*values.shape[:-1], len(pixels.index)), np.float32)
    for item in np.ndindex(*values.shape[:-1]):
        image = coarse.image(values[item])
        extrapolated = np.where(
            weight > 0,
            image,
            cv2.blur(image, (EXTRAPOLATION_PX, EXTRAPOLATION_PX)) / np.maximum(around, 1e-6),
        )
        full = cv2.resize(extrapolated[first:last].astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
        out[item] = pixels.take(np.asarray(full, np.float32)[skipped : skipped + rows, :columns])
    return out
