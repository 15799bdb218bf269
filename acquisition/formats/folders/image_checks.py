"""Checks of a folder's images: black, overexposed or equal images, values that are not numbers, full scale."""

import hashlib
from collections.abc import Iterable

import numpy as np

from acquisition.formats.folders.image_files import FULL_SCALE, FolderImages
from acquisition.formats.folders.refusal import refusal
from acquisition.formats.folders.text_table import listed_file
from acquisition.models.base import BoolArray, FloatArray
from acquisition.normals.images.normalised_images import row_blocks

BLACK_LEVEL = 0.0005
"""Fraction of the `exposed_scale` below which an image's brightest pixels count as black."""

LARGEST_VALUE = 1e30
"""Value of float32 files from which it counts as infinite: some programs mark missing pixels by the type's greatest."""

MAX_BRIGHTEST_RATIO = 4.0
"""Largest ratio of the brightest value of float32 files to the brightest percent of an image that tells how they were
exposed. A highlight, or a single hot pixel, is brighter by any factor. Diffuse images reach 1.5."""

MAX_SATURATED_SHARE = 0.9
"""Share of clipped pixels above which an image is refused."""

SAMPLE_ROWS = 64
"""Rows of each image that are read where a sample suffices."""

LEAST_IMAGES = 3
"""Minimum number of different images from which a normal can be solved."""

CONVERTERS = {10: 1023, 12: 4095, 14: 16383}
"""Greatest values of cameras with fewer bits than the 16 of a file, by number of bits."""

GAP_PX, MIN_PAIRS = 4, 200
"""Distance of the pixels whose residuals are compared, beyond the reach of a demosaicing filter, and the minimum number
of such pairs."""

SAME_SCALE, SAME_SHARE, NOISE_CORRELATION, PLANE_MISFIT = 0.03, 0.05, 0.3, 0.05
"""Images show the same if their scales differ by less than `SAME_SCALE`, their residuals are a smaller share of the
values than `SAME_SHARE` and correlate between pixels by less than `NOISE_CORRELATION`, as noise does, and the best
plane under the lights misses the scales by more than `PLANE_MISFIT`. Measured on 48 captures of design seeds 486–491
(eight families, eight lights by two rings): scales differ by at least 0.28, and residuals are at least 0.12."""


def refuse_unusable(images: FolderImages, mask: BoolArray, saturated_from: float, exposed: float) -> None:
    """Refuses images that are black or saturated within the mask, by a sample of rows, or have non-finite values there.

    `exposed` is the `exposed_scale`. Raises RigError folder.invalid naming the image.
    """
    black = BLACK_LEVEL * exposed / images.full_scale
    for index, name in enumerate(images.names):
        path = listed_file(images.folder, name)
        if images.kind == "float32":
            for rows in row_blocks(images.size[0]):
                values = images(index, rows.start, rows.stop)
                wrong = ~(np.abs(values) < LARGEST_VALUE) & _like(images, mask[rows])
                if np.any(wrong):
                    row, column, *_ = np.argwhere(wrong)[0]
                    raise refusal(
                        path,
                        f"holds values that are not numbers, or infinite, at row {rows.start + row}, column {column}: "
                        "write the image again, or remove these pixels from the mask",
                    )
        values = _sample(images, index, mask).astype(np.float32) / images.full_scale
        if float(np.quantile(values, 0.999)) <= black:
            raise refusal(path, "is black within the mask: capture it again, or remove its row from the list")
        if float(np.mean(values >= saturated_from)) > MAX_SATURATED_SHARE:
            raise refusal(path, "is overexposed within the mask: shorten the exposure, or remove its row from the list")


def exceeds(images: FolderImages, level: float, mask: BoolArray) -> str | None:
    """Returns the name of the first image with a stored value above a level within the mask; None: there is none."""
    for index, name in enumerate(images.names):
        for rows in row_blocks(images.size[0]):
            inside = mask[rows]
            values = images(index, rows.start, rows.stop)
            if np.any(inside) and bool(np.max(values[inside]) > level):
                return name
    return None


def refuse_above_full_scale(images: FolderImages, mask: BoolArray) -> None:
    """Refuses images with values above the stated full scale. Raises RigError folder.invalid naming one."""
    name = exceeds(images, images.full_scale, mask)
    if name is not None:
        raise refusal(
            listed_file(images.folder, name),
            f"holds values above {images.full_scale:g}, which is stated as full scale: correct full_scale",
        )


def unfilled_bits(images: FolderImages, black_level: int = 0) -> str | None:
    """Warns if 16-bit files hold only values of a camera with fewer bits, so that no pixel counts as clipped. Returns
    None if the values fill the 16 bits, or full scale is stated."""
    if images.kind != "uint16" or images.stated_full_scale is not None:
        return None
    top = 0
    for index in range(len(images.names)):
        for rows in row_blocks(images.size[0]):
            top = max(top, black_level + int(np.max(images(index, rows.start, rows.stop))))
            if top > CONVERTERS[14]:
                return None
    bits, end = next((bits, end) for bits, end in CONVERTERS.items() if top <= end)
    if bits == 14 and top <= end / 2:  # what a dark image of 16 bits holds as well
        return None
    return (
        f"No value of the 16-bit files exceeds {top}: if the camera has {bits} bits, state full_scale {end} (in "
        "lights.json, or else with --full-scale); without it no pixel counts as clipped, and where some are, σ is "
        "wrong and the normals are less accurate."
    )


def exposed_scale(images: FolderImages, mask: BoolArray) -> float:
    """Returns the value to which a camera without a stated full scale has probably been exposed: of float32 files the
    brightest one within the mask, unless it is a highlight's, of 16-bit files the end of the camera's range that it
    lies in.

    Without a stated full scale, a first guess of the noise has no other scale. The type's own makes dark images, of 10
    bits or of floating point in another unit, noisier than they are by any factor.
    """
    if images.stated_full_scale is not None or images.kind == "uint8":
        return images.full_scale
    samples = (_sample(images, index, mask) for index in range(len(images.names)))
    if images.kind == "float32":
        brightest, percent = np.max([(np.max(one), np.quantile(one, 0.99)) for one in samples], axis=0).tolist()
        return min(brightest, MAX_BRIGHTEST_RATIO * percent) if percent > 0 else brightest
    brightest = max(float(np.max(one)) for one in samples)
    return next((float(end) for end in CONVERTERS.values() if brightest <= end), images.full_scale)


def excessive_scale(images: FolderImages) -> str | None:
    """Warns if the stated full scale is more than the files can hold, so that no pixel counts as clipped. One more than
    that, a power of two, is accepted."""
    stated, most = images.stated_full_scale, FULL_SCALE[images.kind]
    if images.kind == "float32" or stated is None or stated <= most + 1:
        return None
    return (
        f"The files hold values up to {most:g}, but full_scale is stated as {stated:g}: if it is less, correct it; as "
        "it is, no pixel counts as clipped and σ is wrong."
    )


def equal_images(images: FolderImages, mask: BoolArray) -> list[list[int]]:
    """Returns the numbers of images that hold the same values, a list for each group."""
    alike = _groups([_digest([_sample(images, index, mask)]) for index in range(len(images.names))])
    found: list[list[int]] = []
    for group in alike:  # a sample of rows may be alike by chance
        whole = _groups([_digest(images(one, *_span(rows)) for rows in row_blocks(images.size[0])) for one in group])
        found += [[group[place] for place in same] for same in whole]
    return found


def refuse_same(images: FolderImages, mask: BoolArray, lights: FloatArray) -> list[str]:
    """Warns of equal images. Refuses images of which fewer than three differ, or that all show the same but for noise,
    unless a plane would look the same under `lights` (F, 3), directions times irradiance.

    Raises RigError folder.invalid naming the images.
    """
    groups = equal_images(images, mask)
    if groups and len(images.names) - sum(len(group) - 1 for group in groups) < LEAST_IMAGES:
        first, *others = (images.names[one] for one in groups[0])
        raise refusal(
            listed_file(images.folder, others[0]),
            f"holds the same values as {first}, and fewer than {LEAST_IMAGES} images differ: was the lamp never "
            "switched, or one file copied over others?",
        )
    if not groups and _shows_the_same(images, mask, lights):
        raise refusal(
            images.folder,
            "all images are the same except for noise, although their lights differ: was the lamp never switched?",
        )
    return [
        f"{', '.join(images.names[one] for one in group)} hold the same values under different lights: copy the right "
        "files."
        for group in groups
    ]


def _shows_the_same(images: FolderImages, mask: BoolArray, lights: FloatArray) -> bool:
    """Whether the images differ by noise alone, while those of a plane would differ by more."""
    values: list[FloatArray] = []
    rows = _sample_rows(mask)
    pairs = [np.flatnonzero(mask[row, :-GAP_PX] & mask[row, GAP_PX:]) for row in rows]
    if sum(map(len, pairs)) < MIN_PAIRS:
        return False
    for index in range(len(images.names)):
        lines = [images(index, row, row + 1)[0].astype(np.float64) for row in rows]
        grey = [line if line.ndim == 1 else line.mean(axis=-1) for line in lines]
        near, far = (
            np.concatenate([line[at + gap] for line, at in zip(grey, pairs, strict=True)]) for gap in (0, GAP_PX)
        )
        values.append(np.stack([near, far]))
    stack = np.array(values) / images.full_scale
    mean = np.mean(stack, axis=0)
    power = max(float(np.sum(mean**2)), 1e-12)
    scale = np.sum(stack * mean, axis=(1, 2)) / power
    if np.max(np.abs(scale - 1)) > SAME_SCALE:
        return False
    rest = stack - scale[:, None, None] * mean
    if np.max(np.sum(rest**2, axis=(1, 2))) > SAME_SHARE**2 * power:
        return False
    correlation = [_correlation(near, far) for near, far in rest]
    plane = lights @ np.linalg.lstsq(lights, scale, rcond=None)[0]
    return max(correlation) < NOISE_CORRELATION and float(np.sqrt(np.mean((plane - scale) ** 2))) > PLANE_MISFIT


def _correlation(one: FloatArray, other: FloatArray) -> float:
    one, other = one - np.mean(one), other - np.mean(other)
    return float(np.sum(one * other) / max(float(np.sqrt(np.sum(one**2) * np.sum(other**2))), 1e-12))


def _sample_rows(mask: BoolArray) -> list[int]:
    rows = np.flatnonzero(np.any(mask, axis=1))
    return rows[:: max(1, len(rows) // SAMPLE_ROWS)].tolist()


def _sample(images: FolderImages, index: int, mask: BoolArray) -> np.ndarray:
    """Values (K,) or (K, 3) of an image within the mask, in a sample of rows."""
    return np.concatenate([images(index, row, row + 1)[0][mask[row]] for row in _sample_rows(mask)])


def _like(images: FolderImages, mask: BoolArray) -> BoolArray:
    """Returns a mask of rows in the shape of the images' rows, with an axis for the channels if these have one."""
    return mask if images.channels == 1 else mask[..., None]


def _span(rows: slice) -> tuple[int, int]:
    return rows.start, rows.stop


def _digest(parts: Iterable[np.ndarray]) -> bytes:
    digest = hashlib.blake2b()
    for part in parts:
        digest.update(np.ascontiguousarray(part).data)
    return digest.digest()


def _groups(digests: list[bytes]) -> list[list[int]]:
    """Groups the numbers of equal digests; single ones are left out."""
    found: dict[bytes, list[int]] = {}
    for number, digest in enumerate(digests):
        found.setdefault(digest, []).append(number)
    return [group for group in found.values() if len(group) > 1]
