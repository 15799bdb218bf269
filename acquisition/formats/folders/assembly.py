"""Assembly of the image set that every reader returns, from pixels, lights and masks. The images are checked here."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acquisition import image_values, photometry
from acquisition.formats.folders import image_checks, image_files
from acquisition.formats.folders.image_files import FolderImages
from acquisition.formats.folders.refusal import refusal
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.listing import first_few
from acquisition.models.rounding import percent
from acquisition.normals.images.image_set import FULL_WELL_E, DistantLights, ImageSet, NearLights
from acquisition.normals.solve import SETTINGS as SOLVE_CHECK

MASK, EVALUATION_MASK = "mask.png", "eval_mask.png"

EIGHT_BITS = (
    "The images have 8 bits: dark values are coarse, and values are taken as linear, although 8-bit files are often "
    "gamma-encoded. Use linear 16-bit images if there are any."
)

ABOVE_ONE = (
    "The float32 files hold values above 1, and no full scale is stated: no pixel counts as clipped, as in merged "
    "exposures. If pixels clip, state the value (full_scale in lights.json, or else --full-scale), or σ is wrong."
)

TOLD_GREY_SHARE = 0.01
"""Share of grey pixels of a mask's object from which a warning tells of them."""

LOSSY = (".jpg", ".jpeg")

NO_SATURATION_LEVEL = 1e30
"""Saturation level of floating-point images with values above 1, such as merged exposures: no value is clipped."""


def lossy(names: Sequence[str]) -> list[str]:
    """Returns a warning if images are JPEG files."""
    if not any(name.lower().endswith(LOSSY) for name in names):
        return []
    return ["JPEG images are compressed and mostly gamma-encoded: normals will be tilted and too flat."]


def irradiance(lights: DistantLights) -> FloatArray:
    """Directions (F, 3) to distant lights times their mean intensity."""
    lengths = np.linalg.norm(lights.directions, axis=1, keepdims=True)
    return lights.directions / np.maximum(lengths, 1e-12) * lights.intensities.mean(axis=1, keepdims=True)


def mask_in(images: FolderImages, name: str = MASK) -> BoolArray | None:
    """Reads a mask (H, W) of the folder's images; None: the folder has none. Raises RigError folder.invalid."""
    path = images.folder / name
    return image_files.read_mask(path, images.size) if path.exists() else None


def image_set(
    images: FolderImages, lights: DistantLights | NearLights, mask: BoolArray | None, *, kind: str,
    warnings: list[str], irradiance: FloatArray, black_level: int = 0,
) -> ImageSet:  # fmt: skip
    """Assembles the image set of a folder, with images in the order of `lights`.

    `mask` (H, W) marks the pixels to solve, None: the whole frame. `kind` is the name of the format. `irradiance`
    (F, 3) are directions from the object to the lights times irradiance. `black_level` was subtracted from stored
    values. Raises RigError folder.invalid naming an image that is black or overexposed, equals others or exceeds the
    stated full scale, or a mask that is wrong.
    """
    area = np.ones(images.size, np.bool_) if mask is None else mask
    if mask is not None:
        _refuse_few_pixels(images, mask)
        warnings = [*warnings, *_grey_mask(images.folder / MASK)]
    merged = False
    if images.stated_full_scale is not None:
        image_checks.refuse_above_full_scale(images, area)
    elif images.kind == "float32":
        merged = image_checks.exceeds(images, 1.0, area) is not None
    clipped_from = NO_SATURATION_LEVEL if merged else image_values.SATURATION_SHARE
    exposed = image_checks.exposed_scale(images, area)
    image_checks.refuse_unusable(images, area, clipped_from, exposed)
    warnings = [*warnings, *image_checks.refuse_same(images, area, irradiance)]
    if images.turned:
        warnings.append(
            f"{first_few(images.turned)}: viewers turn or mirror these images, by a tag in the file. They are solved "
            "as stored: mask, lights and camera must fit that. Save images upright, without the tag."
        )
    if merged:
        warnings.append(ABOVE_ONE)
    if images.kind == "uint8":
        warnings.append(EIGHT_BITS)
    elif (unfilled := image_checks.unfilled_bits(images, black_level)) is not None:
        warnings.append(unfilled)
    if (excessive := image_checks.excessive_scale(images)) is not None:
        warnings.append(excessive)
    height, width = images.size
    return ImageSet(
        names=images.names,
        height=height,
        width=width,
        channels=images.channels,
        rows=images,
        full_scale=images.full_scale,
        saturated_from=clipped_from,
        lights=lights,
        mask=area,
        mask_given=mask is not None,
        evaluation_mask=mask_in(images, EVALUATION_MASK),
        full_well_e=FULL_WELL_E * images.full_scale / exposed,
        exposed_level=exposed / images.full_scale if merged else 1.0,
        notes={"format": kind, "warnings": warnings},
    )


def _grey_mask(path: Path) -> list[str]:
    """Returns a warning of a mask with grey pixels, as soft edges and JPEG leave them."""
    share = image_files.grey_share(path)
    if share < TOLD_GREY_SHARE:
        return []
    return [
        f"{path.name} is not only black and white: {percent(share)} of what counts as object is grey. All that is not "
        "quite black counts; if that is more than the object, draw it without soft edges, and not as JPEG."
    ]


def _refuse_few_pixels(images: FolderImages, mask: BoolArray) -> None:
    """Refuses a mask with too few pixels for a solve. Raises RigError folder.invalid."""
    count, most = int(np.count_nonzero(mask)), SOLVE_CHECK.min_pixels
    if count < most or any(one.stop - one.start == 1 for one in photometry.bounding_box(mask)):
        raise refusal(
            images.folder / MASK,
            f"marks only {count} pixel(s); at least {most} in two rows and columns are needed: draw the object white",
        )
