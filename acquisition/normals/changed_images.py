"""Images as they are under another hypothesis: one left out or scaled, translations, a coding or a blur undone.

Lights and window stay; values and clipped pixels are changed as they are read.
"""

import cv2
import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.normals import surface_diffusion
from acquisition.normals.session_images import ImageBlock, Images, StoredImages, derived
from acquisition.normals.surface_diffusion import SurfaceGraph

HALF = 0.5
"""Share of a pixel that has to come from clipped ones for it to count as clipped."""


def without(images: Images, number: int) -> StoredImages:
    """The images without one: its pixels are read as clipped, so that the number of images stays."""

    def read(start: int, stop: int) -> ImageBlock:
        block = images.read(start, stop)
        clipped = block.clipped.copy()
        clipped[number] = True
        return block._replace(clipped=clipped)

    return derived(images, read)


def linearised(images: Images, exponent: float) -> StoredImages:
    """The images with a power law undone: values to the `exponent`, at the level of each image's signal.

    A value's signal is proportional to value / shot; factors common to all images are part of the albedo. Their noise
    is that of a mid-grey value, which the exponent multiplies.
    """
    level = (np.min(images.shot) / images.shot)[:, None, None].astype(np.float32)

    def read(start: int, stop: int) -> ImageBlock:
        block = images.read(start, stop)
        return block._replace(values=np.maximum(block.values * level, 0) ** np.float32(exponent) / level)

    return derived(images, read, images.shot * exponent**2, images.floor * exponent**2)


def scaled(images: Images, factors: FloatArray) -> StoredImages:
    """The images divided by a factor each (F,), and their noise with them."""

    def read(start: int, stop: int) -> ImageBlock:
        block = images.read(start, stop)
        return block._replace(values=block.values / factors[:, None, None].astype(np.float32))

    return derived(images, read, images.shot / factors, images.floor / factors**2)


def translated(images: Images, translation: FloatArray, spacing: int = 1) -> StoredImages:
    """The images with each one's content moved by −`translation` (F, 2), pixels in x and y, by cubic interpolation, of
    a mosaic among the sites of each place in its cells, whose side is `spacing` px.

    Noise is left as it is, though interpolation lowers it.
    """
    margin = spacing * (int(np.ceil(np.max(np.abs(translation)) / spacing)) + 1)

    def moved(image: Float32Array, shift: FloatArray) -> Float32Array:
        out = np.empty_like(image)
        for row in range(spacing):
            for column in range(spacing):
                alike = (slice(row, None, spacing), slice(column, None, spacing))
                out[alike] = shifted(np.ascontiguousarray(image[alike]), -shift / spacing)
        return out

    def read(start: int, stop: int) -> ImageBlock:
        first, last = max(start - margin, 0), min(stop + margin, images.rows.stop - images.rows.start)
        values, clipped, extra = images.read(first, last)
        own = slice(start - first, stop - first)
        out = [moved(image, shift)[own] for image, shift in zip(values, translation, strict=True)]
        full = [moved(one.astype(np.float32), shift)[own] for one, shift in zip(clipped, translation, strict=True)]
        return ImageBlock(np.stack(out), np.stack(full) >= HALF, None if extra is None else extra[:, own])

    return derived(images, read)


def sharpened(images: Images, over: SurfaceGraph, albedo: Float32Array, length_px: float, gain: float) -> StoredImages:
    """The images with the spread of light below the surface undone, by a mean of `length_px` pixels along the graph of
    the window; `gain` is the factor of their noise's variance.

    What is sharpened is the irradiance: values over the albedo (h, w). Where that is 0, values stay as they are.
    """
    margin = surface_diffusion.reach(length_px)

    def read(start: int, stop: int) -> ImageBlock:
        first, last = max(start - margin, 0), min(stop + margin, images.rows.stop - images.rows.start)
        values, clipped, extra = images.read(first, last)
        own, graph, white = slice(start - first, stop - first), over.rows(first, last), albedo[first:last]
        known = white > 0
        out = values[:, own].copy()
        for number, image in enumerate(values):
            irradiance = np.divide(image, white, out=np.zeros_like(white), where=known)
            sharp = surface_diffusion.sharpened(irradiance, graph, length_px)
            np.multiply(sharp[own], white[own], out=out[number], where=known[own])
        return ImageBlock(out, clipped[:, own], None if extra is None else extra[:, own])

    return derived(images, read, images.shot * gain, images.floor * gain)


def shifted(image: Float32Array, shift: FloatArray) -> Float32Array:
    """An image (h, w) with its content moved by `shift` (2,), pixels in x and y; cubic interpolation."""
    matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    size = (image.shape[1], image.shape[0])
    return np.asarray(
        cv2.warpAffine(image, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32
    )
