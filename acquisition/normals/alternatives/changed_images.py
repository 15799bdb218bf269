"""Images under another hypothesis: one left out, some scaled or translated, a coding or a blur undone.

Lights and window stay as they are. Values and clipped pixels are changed when they are read.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.normals.images.normalised_images import ImageBlock, Images
from acquisition.normals.indirect_light import surface_diffusion
from acquisition.normals.indirect_light.surface_diffusion import SurfaceGraph

HALF = 0.5
"""Share of an interpolated pixel that has to come from clipped ones for it to count as clipped."""


def _changed(images: Images, change: Callable[[ImageBlock, int], ImageBlock], margin: int = 0) -> Images:
    """Returns images whose blocks are changed when they are read, with a `margin` of rows above and below. `change`
    receives a block and the number of its first row."""

    def read(start: int, stop: int) -> ImageBlock:
        first = max(start - margin, 0)
        block = change(images.read(first, min(stop + margin, images.height)), first)
        return block.rows(start - first, stop - first)

    return replace(images, read=read)


def without(images: Images, number: int) -> Images:
    """Returns the images without one: its pixels are read as clipped, so that the number of images stays."""

    def change(block: ImageBlock, _: int) -> ImageBlock:
        clipped = block.clipped.copy()
        clipped[number] = True
        return block._replace(clipped=clipped)

    return _changed(images, change)


def below_black(images: Images, offset: float) -> Images:
    """Returns the images with values at black replaced by `offset`, as if values below zero had been stored."""

    def change(block: ImageBlock, _: int) -> ImageBlock:
        return block._replace(values=np.where(block.values <= 0, np.float32(offset), block.values))

    return _changed(images, change)


def linearised(images: Images, exponent: float) -> Images:
    """Returns the images with a power law undone: values to the `exponent`, at the level of each image's signal.

    A value's signal is proportional to value / shot; factors common to all images are part of the albedo. The standard
    deviation of the noise is multiplied by the exponent, as for a mid-grey value.
    """
    level = (np.min(images.shot) / images.shot)[:, None, None].astype(np.float32)

    def change(block: ImageBlock, _: int) -> ImageBlock:
        return block._replace(values=np.maximum(block.values * level, 0) ** np.float32(exponent) / level)

    return replace(_changed(images, change), shot=images.shot * exponent**2, floor=images.floor * exponent**2)


def scaled(images: Images, factors: FloatArray) -> Images:
    """Returns the images divided by one factor each (F,), with their noise."""

    def change(block: ImageBlock, _: int) -> ImageBlock:
        return block._replace(values=block.values / factors[:, None, None].astype(np.float32))

    return replace(_changed(images, change), shot=images.shot / factors, floor=images.floor / factors**2)


def translated(images: Images, translation: FloatArray, spacing: int = 1) -> Images:
    """Returns the images with the content of each moved by −`translation` (F, 2), pixels in x and y.

    Interpolation is cubic. In a mosaic, it is done among the sites of the same place in their cells, whose side is
    `spacing` px. The noise stays as it is, although interpolation lowers it.
    """

    def moved(images: np.ndarray) -> Float32Array:
        out = np.empty(images.shape, np.float32)
        for row, column in np.ndindex(spacing, spacing):
            alike = (slice(row, None, spacing), slice(column, None, spacing))
            for image, shift, into in zip(images, translation, out, strict=True):
                into[alike] = shifted(np.ascontiguousarray(image[alike], np.float32), -shift / spacing)
        return out

    def change(block: ImageBlock, _: int) -> ImageBlock:
        return block._replace(values=moved(block.values), clipped=moved(block.clipped) >= HALF)

    return _changed(images, change, spacing * (int(np.ceil(np.max(np.abs(translation)) / spacing)) + 1))


def sharpened(images: Images, over: SurfaceGraph, albedo: Float32Array, length_px: float, gain: float) -> Images:
    """Returns the images with the spread of light below the surface undone.

    The irradiance, values over the albedo (h, w), is sharpened for a mean free path of `length_px` pixels along the
    graph of the window. Where the albedo is 0, values stay as they are. `gain` is the factor of the noise's variance.
    """

    def change(block: ImageBlock, first: int) -> ImageBlock:
        rows = slice(first, first + block.values.shape[1])
        graph, white = over.rows(rows.start, rows.stop), albedo[rows]
        known, out = white > 0, block.values.copy()
        for image in out:
            irradiance = np.divide(image, white, out=np.zeros_like(white), where=known)
            sharp = surface_diffusion.sharpened(irradiance, graph, length_px)
            np.multiply(sharp, white, out=image, where=known)
        return block._replace(values=out)

    sharp = _changed(images, change, surface_diffusion.reach(length_px))
    return replace(sharp, shot=images.shot * gain, floor=images.floor * gain)


def shifted(image: Float32Array, shift: FloatArray) -> Float32Array:
    """Returns an image (h, w) with its content moved by `shift` (2,), pixels in x and y, by cubic interpolation."""
    matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    size = (image.shape[1], image.shape[0])
    return np.asarray(
        cv2.warpAffine(image, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32
    )
