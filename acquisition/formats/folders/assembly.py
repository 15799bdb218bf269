"""Assembly of the image set that every reader returns: pixels, lights and masks, with the images checked once."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acquisition.formats.folders import image_files
from acquisition.formats.folders.image_files import StoredImages
from acquisition.models.base import BoolArray
from acquisition.normals.image_set import DistantLights, ImageSet, NearLights

MASK, EVALUATION_MASK = "mask.png", "eval_mask.png"

EIGHT_BITS = (
    "The images have 8 bits: dark pixels are coarse, and 8-bit files are often gamma-encoded; they are taken as "
    "linear. Use 16-bit linear images where there are any."
)

SATURATION_LEVEL = 0.985
"""Share of full scale from which a value counts as clipped."""

NO_SATURATION_LEVEL = 1e30
"""Level of floating-point images with values above 1, such as merged exposures: none counts as clipped."""


def mask_in(folder: Path, stored: StoredImages, name: str = MASK) -> BoolArray | None:
    """A mask (H, W) of the folder's images, none when the folder has none. Raises RigError folder.invalid."""
    path = folder / name
    return image_files.read_mask(path, stored.height, stored.width) if path.exists() else None


def image_set(
    folder: Path, names: Sequence[str], paths: Sequence[Path], stored: StoredImages, lights: DistantLights | NearLights,
    mask: BoolArray | None, *, kind: str, warnings: Sequence[str],
) -> ImageSet:  # fmt: skip
    """Assembles the image set of a folder, `paths` in the order of `lights`, solved in `mask` (H, W), none: the whole
    frame; `kind` is the format's name.

    Raises RigError folder.invalid naming an image that is black or overexposed, or an evaluation mask that is wrong.
    """
    merged = stored.dtype == "float32" and image_files.exceeds(stored, 1.0)
    clipped_from = NO_SATURATION_LEVEL if merged else SATURATION_LEVEL
    area = np.ones((stored.height, stored.width), np.bool_) if mask is None else mask
    image_files.refuse_unusable(stored, paths, area, clipped_from)
    return ImageSet(
        names=tuple(names),
        height=stored.height,
        width=stored.width,
        channels=stored.channels,
        rows=stored.rows,
        full_scale=stored.full_scale,
        saturated_from=clipped_from,
        lights=lights,
        mask=area,
        mask_given=mask is not None,
        evaluation_mask=mask_in(folder, stored, EVALUATION_MASK),
        notes={"format": kind, "warnings": [*warnings, EIGHT_BITS] if stored.dtype == "uint8" else list(warnings)},
    )
