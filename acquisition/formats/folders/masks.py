"""Masks of a folder, and warnings about its files' bit depth."""

from pathlib import Path

from acquisition.formats.folders import image_files
from acquisition.formats.folders.image_files import StoredImages
from acquisition.models.base import BoolArray

MASK, EVALUATION_MASK = "mask.png", "eval_mask.png"
LOSSY = (".jpg", ".jpeg")


def solving(folder: Path, height: int, width: int) -> BoolArray | None:
    """The object's mask (H, W), none when the folder has none. Raises RigError folder.invalid."""
    path = folder / MASK
    return image_files.read_mask(path, height, width) if path.exists() else None


def evaluation(folder: Path, height: int, width: int) -> BoolArray | None:
    """Where errors are graded (H, W), none when the folder does not say. Raises RigError folder.invalid."""
    path = folder / EVALUATION_MASK
    return image_files.read_mask(path, height, width) if path.exists() else None


def depth_warning(stored: StoredImages) -> list[str]:
    """Sentences on images whose numbers are coarser than a camera's, or not linear."""
    warnings: list[str] = []
    if stored.dtype == "uint8":
        warnings.append(
            "The images have 8 bits: dark pixels are coarse, and 8-bit files are often gamma-encoded; they are taken "
            "as linear. Use 16-bit linear images where there are any."
        )
    return warnings
