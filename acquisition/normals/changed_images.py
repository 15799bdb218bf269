"""Images as they are under another hypothesis: one left out or scaled, translations, a coding or a blur undone."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.light_plan import Light
from acquisition.normals import surface_diffusion
from acquisition.normals.session_images import ImageBlock, Images
from acquisition.normals.surface_diffusion import SurfaceGraph


@dataclass(frozen=True)
class Changed:
    """`Images` of which lights, window and noise stay, and values and clipped pixels are changed as they are read."""

    images: Images
    shot: FloatArray
    floor: FloatArray

    @property
    def lights(self) -> tuple[Light, ...]:
        """The light of each image (F)."""
        return self.images.lights

    @property
    def rows(self) -> slice:
        """The window's rows in the frame."""
        return self.images.rows

    @property
    def columns(self) -> slice:
        """The window's columns in the frame."""
        return self.images.columns

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        return self.images.read(start, stop)


@dataclass(frozen=True)
class WithoutImage(Changed):
    """One image left out: its pixels are read as clipped, so that the number of images stays."""

    number: int = 0

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        block = self.images.read(start, stop)
        clipped = block.clipped.copy()
        clipped[self.number] = True
        return block._replace(clipped=clipped)


@dataclass(frozen=True)
class Linearised(Changed):
    """Power law undone: values to the `exponent`, at the level of each image's signal.

    A value's signal is proportional to value / shot; factors common to all images are part of the albedo.
    """

    exponent: float = 1.0

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        block = self.images.read(start, stop)
        level = (np.min(self.images.shot) / self.images.shot)[:, None, None].astype(np.float32)
        return block._replace(values=np.maximum(block.values * level, 0) ** np.float32(self.exponent) / level)


@dataclass(frozen=True)
class Scaled(Changed):
    """Values divided by a factor of each image (F,)."""

    factors: FloatArray = field(default_factory=lambda: np.ones(0))

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        block = self.images.read(start, stop)
        return block._replace(values=block.values / self.factors[:, None, None].astype(np.float32))


@dataclass(frozen=True)
class Translated(Changed):
    """Each image's content moved by −`translation` (F, 2), pixels in x and y; cubic interpolation, of a mosaic
    among the sites of each place in its cells, which lie `spacing` pixels apart."""

    translation: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    spacing: int = 1

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        height = self.rows.stop - self.rows.start
        margin = self.spacing * (int(np.ceil(np.max(np.abs(self.translation)) / self.spacing)) + 1)
        first, last = max(start - margin, 0), min(stop + margin, height)
        values, clipped, extra = self.images.read(first, last)
        own = slice(start - first, stop - first)
        out, full = np.empty_like(values[:, own]), np.empty_like(clipped[:, own])
        for number, shift in enumerate(self.translation):
            out[number] = self._shifted(values[number], shift)[own]
            full[number] = self._shifted(clipped[number].astype(np.float32), shift)[own] >= HALF
        return ImageBlock(out, full, None if extra is None else extra[:, own])

    def _shifted(self, image: Float32Array, shift: FloatArray) -> Float32Array:
        out, step = np.empty_like(image), self.spacing
        for row in range(step):
            for column in range(step):
                alike = (slice(row, None, step), slice(column, None, step))
                out[alike] = shifted(np.ascontiguousarray(image[alike]), -shift / step)
        return out


@dataclass(frozen=True)
class Sharpened(Changed):
    """The spread of light below the surface undone, by a mean of `length_px` pixels along the graph of the window.

    What is sharpened is the irradiance: values over the albedo (h, w). Where that is 0, values stay as they are.
    """

    over: SurfaceGraph = field(default_factory=lambda: surface_diffusion.EMPTY)
    albedo: Float32Array = field(default_factory=lambda: np.zeros((1, 1), np.float32))
    length_px: float = 0.0

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        margin = surface_diffusion.reach(self.length_px)
        first, last = max(start - margin, 0), min(stop + margin, self.rows.stop - self.rows.start)
        values, clipped, extra = self.images.read(first, last)
        own, over, albedo = slice(start - first, stop - first), self.over.rows(first, last), self.albedo[first:last]
        known = albedo > 0
        out = values[:, own].copy()
        for number, image in enumerate(values):
            irradiance = np.divide(image, albedo, out=np.zeros_like(albedo), where=known)
            sharp = surface_diffusion.sharpened(irradiance, over, self.length_px)
            np.multiply(sharp[own], albedo[own], out=out[number], where=known[own])
        return ImageBlock(out, clipped[:, own], None if extra is None else extra[:, own])


HALF = 0.5
"""Share of a pixel that has to come from clipped ones for it to count as clipped."""


def shifted(image: Float32Array, shift: FloatArray) -> Float32Array:
    """An image (h, w) with its content moved by `shift` (2,), pixels in x and y; cubic interpolation."""
    matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    size = (image.shape[1], image.shape[0])
    return np.asarray(
        cv2.warpAffine(image, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32
    )


def scaled(images: Images, factors: FloatArray) -> Scaled:
    """The images divided by a factor each, and their noise with them."""
    return Scaled(images, images.shot / factors, images.floor / factors**2, factors)


def translated(images: Images, translation: FloatArray, spacing: int = 1) -> Translated:
    """The images with their translations undone; noise is left as it is, though interpolation lowers it. `spacing` is
    the side of a mosaic's cell, px."""
    return Translated(images, images.shot, images.floor, translation, spacing)


def without(images: Images, number: int) -> WithoutImage:
    """The images without one."""
    return WithoutImage(images, images.shot, images.floor, number)


def sharpened(images: Images, over: SurfaceGraph, albedo: Float32Array, length_px: float, gain: float) -> Sharpened:
    """The images with light gathered back along a surface; `gain` is the factor of their noise's variance."""
    return Sharpened(images, images.shot * gain, images.floor * gain, over, albedo, length_px)


def linearised(images: Images, exponent: float) -> Linearised:
    """The images with a power law undone; their noise is that of a mid-grey value, which the exponent multiplies."""
    return Linearised(images, images.shot * exponent**2, images.floor * exponent**2, exponent)
