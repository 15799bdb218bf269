"""DiLiGenT-style folders: `filenames.txt`, light directions and RGB intensities, `mask.png`, 16-bit PNG images.

Directions are in the view frame already (x right, y up, z to the camera). Each channel is divided by its own intensity,
a grey image by the mean of the three.
"""

from pathlib import Path

import numpy as np

from acquisition.formats.folders import assembly, image_files, text_table
from acquisition.formats.folders.image_files import Progress
from acquisition.formats.folders.refusal import refusal
from acquisition.normals.images.image_set import DistantLights, ImageSet

NAMES, DIRECTIONS, INTENSITIES = "filenames.txt", "light_directions.txt", "light_intensities.txt"
LISTS = (DIRECTIONS, NAMES, INTENSITIES)
"""Any of these files marks a folder as DiLiGenT-style."""


def read(
    path: Path, scratch: Path, progress: Progress | None = None, full_scale: float | None = None
) -> ImageSet:  # fmt: skip
    """Reads the folder of a file of directions; `full_scale` is the stored value of 1.0, by default the type's.

    Raises RigError folder.invalid naming the file that is wrong.
    """
    folder = path.parent
    names = tuple(name for _, name in text_table.lines(folder / NAMES))
    if not names:
        raise refusal(folder / NAMES, "names no images: write one file name per line")
    directions = text_table.rows(path, (3,), len(names), NAMES)
    intensities = text_table.rows(folder / INTENSITIES, (1, 3), len(names), NAMES)
    if np.any(intensities <= 0):
        row = int(np.argmax(np.any(intensities <= 0, axis=1)))
        line, _ = text_table.lines(folder / INTENSITIES)[row]
        raise refusal(folder / INTENSITIES, f"line {line} is not positive: correct it, or remove the image")
    images = image_files.open_images(folder, names, scratch, progress=progress, full_scale=full_scale)
    warnings = assembly.lossy(names)
    if images.channels == 1 and intensities.shape[1] == 3:
        if not np.allclose(intensities, intensities[:, :1]):
            warnings.append("Grey images with three intensities each: the mean of the three is used.")
        intensities = intensities.mean(axis=1, keepdims=True)
    elif images.channels == 3 and intensities.shape[1] == 1:
        intensities = np.repeat(intensities, 3, axis=1)
    mask = image_files.read_mask(folder / assembly.MASK, images.size)
    lights = DistantLights(directions, intensities)
    return assembly.image_set(
        images, lights, mask, kind="DiLiGenT", warnings=warnings,
        irradiance=assembly.irradiance(lights),
    )  # fmt: skip
