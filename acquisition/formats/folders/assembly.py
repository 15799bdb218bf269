"""Assembly of the image set that every reader returns: pixels, lights and masks, with the images checked once."""

import numpy as np

from acquisition import image_values
from acquisition.formats.folders import image_files
from acquisition.formats.folders.image_files import FolderImages
from acquisition.models.base import BoolArray
from acquisition.normals.images.image_set import DistantLights, ImageSet, NearLights

MASK, EVALUATION_MASK = "mask.png", "eval_mask.png"

EIGHT_BITS = (
    "The images have 8 bits: dark pixels are coarse, and 8-bit files are often gamma-encoded; they are taken as "
    "linear. Use 16-bit linear images where there are any."
)

NO_SATURATION_LEVEL = 1e30
"""Level of floating-point images with values above 1, such as merged exposures: none counts as clipped."""


def mask_in(images: FolderImages, name: str = MASK) -> BoolArray | None:
    """A mask (H, W) of the folder's images, none when the folder has none. Raises RigError folder.invalid."""
    path = images.folder / name
    return image_files.read_mask(path, images.size) if path.exists() else None


def image_set(
    images: FolderImages, lights: DistantLights | NearLights, mask: BoolArray | None, *, kind: str, warnings: list[str]
) -> ImageSet:
    """Assembles the image set of a folder, images in the order of `lights`, solved in `mask` (H, W), none: the whole
    frame; `kind` is the format's name.

    Raises RigError folder.invalid naming an image that is black or overexposed, or an evaluation mask that is wrong.
    """
    merged = images.kind == "float32" and image_files.exceeds(images, 1.0)
    clipped_from = NO_SATURATION_LEVEL if merged else image_values.SATURATION_SHARE
    area = np.ones(images.size, np.bool_) if mask is None else mask
    image_files.refuse_unusable(images, area, clipped_from)
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
        notes={"format": kind, "warnings": [*warnings, EIGHT_BITS] if images.kind == "uint8" else list(warnings)},
    )
