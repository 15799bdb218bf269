"""A DiLiGenT-style folder, which most photometric-stereo programs read.

The format knows distant lights only: near ones are given by direction and strength at the object's centre, and
`README.txt` says so.
"""

from pathlib import Path

import numpy as np

from acquisition.formats.export import light_files, map_files
from acquisition.models.base import FloatArray
from acquisition.normals.image_set import DistantLights, ImageSet

EIGHT_TO_SIXTEEN = 257
NEAR_LIGHT = (
    "The lamps stood near the object. Directions and intensities are those at its centre; away from it both differ, "
    "so a solver for distant light is wrong by degrees at the edges. Positions in mm are in lights.dome.\n"
)


def write(folder: Path, images: ImageSet, centre_m: FloatArray) -> None:
    """Writes 001.png … (16 bits), filenames, directions, intensities and mask.png into an existing folder."""
    names = [f"{number:03d}.png" for number in range(1, images.count + 1)]
    for index, name in enumerate(names):
        map_files.png(folder / name, _sixteen(images, index))
    power = light_files.intensities(images, centre_m)
    (folder / "filenames.txt").write_text("\n".join(names) + "\n", encoding="utf-8")
    np.savetxt(folder / "light_directions.txt", light_files.directions(images, centre_m), fmt="%.9f")
    np.savetxt(folder / "light_intensities.txt", np.broadcast_to(power, (images.count, 3)), fmt="%.9g")
    map_files.png(folder / "mask.png", images.mask.astype(np.uint8) * 255)
    if not isinstance(images.lights, DistantLights):
        (folder / "README.txt").write_text(NEAR_LIGHT, encoding="utf-8")


def _sixteen(images: ImageSet, index: int) -> np.ndarray:
    pixels = images.rows(index, 0, images.height)
    match pixels.dtype.name:
        case "uint16":
            return pixels
        case "uint8":
            return pixels.astype(np.uint16) * EIGHT_TO_SIXTEEN
        case _:
            scaled = np.clip(pixels / np.float32(images.full_scale), 0, 1) * 65535
            return np.round(scaled).astype(np.uint16)
