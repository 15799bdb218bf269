"""Images of one object with known lights, from any source: what folder readers return and solvers read.

Pixels stay in place and are read in blocks of rows, in their stored type, because solvers are limited by memory and
sixteen-bit integers take half the bytes of floats. A stack of any size can be solved as long as its reader returns rows
without holding every image. If a format decodes only whole images, its reader has to unpack them once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn, Protocol

import numpy as np
import numpy.typing as npt

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class ImageCheckSettings:
    """Tuned number of the check of lights."""

    min_direction_spread: float = tuned(0.02, "1")
    """Least `direction_spread` of lights; below it they count as lying in one plane with the object, and are refused.
    Measured: near lights of 0.03 give an error of 8.5° at a σ of 10.5°
    (`test_solve_lights_close_together_has_a_sigma_that_says_so`)."""


SETTINGS = ImageCheckSettings()

POSITION_SIGMA_M, INTENSITY_SIGMA = 0.001, 0.01
"""1 σ of a near light's position per axis and of its intensity, as a share, if the source does not state them."""

FULL_WELL_E, READ_NOISE_E = 10_000.0, 5.0
"""Electrons at full scale and read noise of a small pixel, if the source does not state them."""

EIGHT_BIT_SCALE = 255.0
"""Greatest value of eight bits, and the least full scale of integers that are stored as floating-point values."""

StoredValues = npt.NDArray[np.uint8] | npt.NDArray[np.uint16] | npt.NDArray[np.float32]


class RowReader(Protocol):
    """Reads rows of stored images; picklable, so that another process can read them."""

    def __call__(self, image: int, start: int, stop: int) -> StoredValues:
        """Reads rows [start, stop) of image number `image`: (rows, W) grey or (rows, W, 3) in the order R, G, B.

        Values are linear, above black, in the stored type of all images (uint8, uint16 or float32), C-contiguous.
        """
        ...


@dataclass(frozen=True)
class DistantLights:
    """Lights so far away that each has one direction for the whole object.

    `directions` (F, 3) point from the object to the light, in the view frame (x right, y up, z to the camera), with any
    length. Images are divided by `intensities` (F, C), one column per channel.
    """

    directions: FloatArray
    intensities: FloatArray

    @property
    def units(self) -> FloatArray:
        """Unit directions (F, 3)."""
        return self.directions / np.linalg.norm(self.directions, axis=1, keepdims=True)


@dataclass(frozen=True)
class NearLights:
    """Point lights at `positions_m` (F, 3) in the view frame (origin at the camera).

    `intensity` (F,) is the value, as a fraction of full scale and mean over the channels, of a perfectly white
    Lambertian surface that faces the lamp at `reference_m`. `colour` (F, C) is each channel's ratio to that mean; none:
    white light. `position_sigma_m` is 1 σ of positions per axis, `intensity_sigma` that of intensities, as a share.
    """

    positions_m: FloatArray
    intensity: FloatArray
    reference_m: float
    colour: FloatArray | None = None
    position_sigma_m: float = POSITION_SIGMA_M
    intensity_sigma: float = INTENSITY_SIGMA

    def of_channels(self, count: int) -> FloatArray:
        """Returns `intensity` in each of `count` channels (F, C)."""
        return self.intensity[:, None] * (np.ones((1, count)) if self.colour is None else self.colour[:, :count])


@dataclass(frozen=True)
class Camera:
    """A calibrated pinhole camera: matrix K (3, 3) in pixels and OpenCV's distortion (k1 k2 p1 p2 k3)."""

    matrix: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))


@dataclass(frozen=True)
class ImageSet:
    """Images of one object from one view, each under one known light."""

    names: tuple[str, ...]
    """The file of each image (F), for messages."""
    height: int
    width: int
    channels: int
    """1 or 3."""
    rows: RowReader
    full_scale: float
    """The stored value that is 1.0 as a fraction of full scale."""
    saturated_from: float
    """Fraction of full scale from which a value counts as clipped."""
    lights: DistantLights | NearLights
    mask: BoolArray
    """(H, W) the object: where normals are solved."""
    mask_given: bool = True
    """False: the source has no mask; `mask` is the whole frame, and a solver may propose one."""
    camera: Camera | None = None
    """None: orthographic."""
    evaluation_mask: BoolArray | None = None
    """(H, W) where errors are graded; none: the mask."""
    truth: Float32Array | None = None
    """(H, W, 3) true normals, view frame."""
    rough_depth_m: float | None = None
    """The object's rough depth along OpenCV's z."""
    metric: bool = True
    """Whether lengths are known; False: near lights and camera stand for directions, at arbitrary distances."""
    full_well_e: float = FULL_WELL_E
    """Electrons at full scale, for a first guess of shot noise."""
    read_noise_e: float = READ_NOISE_E
    """Read noise, e⁻, for a first guess."""
    exposed_level: float = 1.0
    """Fraction of full scale to which further images can be exposed: above 1 where no value of the images clips, as in
    merged exposures."""
    numbers: tuple[int, ...] = ()
    """The number of each image in its source, if these are only some of its images; empty: all, counted from 0."""
    notes: dict[str, Any] = field(default_factory=dict[str, Any])
    """Facts from the reader for the report."""

    @property
    def count(self) -> int:
        """Number of images."""
        return len(self.names)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the images (F) in messages: number in the source, counted from 0, and file."""
        numbers = self.numbers or range(self.count)
        return tuple(f"{number} ({name})" for number, name in zip(numbers, self.names, strict=True))

    @property
    def quantised(self) -> bool:
        """Whether stored values have a step of 1: integers, and floating-point values with the full scale of some."""
        return self.full_scale > 1 and (self.full_scale >= EIGHT_BIT_SCALE or self.rows(0, 0, 1).dtype.kind != "f")

    def only(self, chosen: Sequence[int]) -> "ImageSet":
        """Returns the images with the numbers `chosen`, in that order, with their lights."""
        numbers = list(chosen)
        lights = self.lights
        if isinstance(lights, DistantLights):
            kept: DistantLights | NearLights = DistantLights(lights.directions[numbers], lights.intensities[numbers])
        else:
            kept = replace(
                lights,
                positions_m=lights.positions_m[numbers],
                intensity=lights.intensity[numbers],
                colour=None if lights.colour is None else lights.colour[numbers],
            )
        names = tuple(self.names[number] for number in numbers)
        own = tuple(self.numbers[number] if self.numbers else number for number in numbers)
        return replace(self, names=names, numbers=own, rows=_ChosenRows(self.rows, tuple(numbers)), lights=kept)

    def values(self, image: int, start: int, stop: int) -> Float32Array:
        """Reads rows [start, stop) of one image as fractions of full scale, float32 (rows, W) or (rows, W, 3)."""
        return self.rows(image, start, stop).astype(np.float32) * np.float32(1.0 / self.full_scale)


@dataclass(frozen=True)
class _ChosenRows:
    """Reads rows of some of the images of another reader, by their numbers there."""

    rows: RowReader
    chosen: tuple[int, ...]

    def __call__(self, image: int, start: int, stop: int) -> StoredValues:
        return self.rows(self.chosen[image], start, stop)


def direction_spread(vectors: FloatArray | Float32Array) -> float:
    """Returns the smallest singular value of unit light directions over √F, for vectors (F, 3) of any length.

    It is 0 if the directions lie in one plane, so that one component of the normal is not determined.
    """
    units = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return float(np.linalg.svd(units, compute_uv=False)[-1] / np.sqrt(len(units)))


def refuse_coplanar(vectors: FloatArray | Float32Array) -> None:
    """Raises RigError normals.infeasible if directions (F, 3) from object to lights, of any length, are in one
    plane."""
    spread = direction_spread(vectors)
    if not spread > SETTINGS.min_direction_spread:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "the lights are parallel or lie in one plane with the object: take images with lights from other sides",
            spread=spread,
        )


def check(images: ImageSet) -> None:
    """Validates lights and mask, and refuses a set that no solver can solve, whatever its pixel values.

    Raises RigError normals.infeasible if there are fewer than three images, if lights and images differ in number, if a
    number is not finite, if a light has no direction or intensity, or if the mask is empty or of another size; for
    distant lights also if they lie in one plane or most are behind the object.
    """
    lights = images.lights
    distant = isinstance(lights, DistantLights)
    first, strength = (
        (lights.directions, lights.intensities) if distant else (lights.positions_m, lights.intensity[:, None])
    )

    def refuse(detail: str, **context: str) -> NoReturn:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, detail, **context)

    if images.count < 3:
        refuse(
            f"{images.count} image(s) ({', '.join(images.names) or 'none'}): a normal needs at least three lights; "
            "add images from other lights"
        )
    if first.shape != (images.count, 3) or len(strength) != images.count:
        refuse(
            f"{images.count} images but {len(first)} lights and {len(strength)} intensities: give one row for each "
            "image, in the images' order"
        )
    for name, place, power in zip(images.names, first, strength, strict=True):
        if not np.all(np.isfinite(place)) or (distant and not np.linalg.norm(place) > 0):
            where = f"its light {place.tolist()} is not a valid position or direction: correct that row"
            refuse(f"{name}: {where}", file=name)
        if not np.all(np.isfinite(power)) or not np.all(power > 0):
            refuse(
                f"{name}: its light's intensity is {power.tolist()}, but must be positive: correct that row", file=name
            )
    if images.mask.shape != (images.height, images.width) or not np.any(images.mask):
        refuse(
            f"the mask is empty, or not {images.width} × {images.height} pixels like {images.names[0]}: draw it round "
            "the object in an image of that size"
        )
    if distant:
        refuse_coplanar(first)
        behind = np.count_nonzero(first[:, 2] <= 0)
        if 2 * behind > len(first):
            refuse(
                f"{behind} of {len(first)} lights are behind the object: give directions from the object to the light, "
                "with x to the right, y up and z to the camera"
            )
