"""`.lp` folders: a text file with the number of images and `name x y z` for each, the images beside it.

The format has no intensities, so all lights count as equally bright. Names may contain spaces, or folders of the
machine that wrote them; in that case the last part of the name is looked for beside the file.
"""

from pathlib import Path

import numpy as np

from acquisition.formats.folders import assembly, image_files, text_table
from acquisition.formats.folders.image_files import Progress
from acquisition.formats.folders.refusal import refusal
from acquisition.normals.images.image_set import DistantLights, ImageSet


def read(
    path: Path, scratch: Path, progress: Progress | None = None, full_scale: float | None = None
) -> ImageSet:  # fmt: skip
    """Reads an `.lp` file and its images; `full_scale` is the stored value of 1.0, by default the type's.

    Raises RigError folder.invalid naming the file that is wrong.
    """
    (line, first), *rest = text_table.lines(path) or [(1, "")]
    if not first.isdecimal():
        raise refusal(path, f"line {line} is {first[:40]!r}: write the number of images there")
    if int(first) != len(rest):
        raise refusal(
            path, f"line {line} says {first} images, but {len(rest)} rows follow: give one `name x y z` for each"
        )
    names: list[str] = []
    directions: list[list[float]] = []
    for line, row in rest:
        words = row.rsplit(maxsplit=3)
        if len(words) != 4:
            raise refusal(path, f"line {line} is {row[:60]!r}: write `name x y z`")
        names.append(words[0])
        directions.append(text_table.numbers(path, line, words[1:]))
        if not np.any(directions[-1]):
            raise refusal(path, f"line {line} has a direction of length zero: correct it, or remove the image")
    if not names:
        raise refusal(path, "names no images: write `name x y z` for each")
    images = image_files.open_images(path.parent, names, scratch, progress=progress, full_scale=full_scale)
    object_mask = assembly.mask_in(images)
    warnings = ["An .lp file has no light intensities: they are assumed equal at first and estimated from the images."]
    if object_mask is None:
        warnings.append(
            f"There is no {assembly.MASK}: pixels that no light reaches are left out (mask_proposed.png of a result)."
        )
    warnings += assembly.lossy(names)
    lights = DistantLights(np.array(directions), np.ones((len(names), images.channels)))
    return assembly.image_set(
        images, lights, object_mask, kind=".lp", warnings=warnings,
        irradiance=assembly.irradiance(lights),
    )  # fmt: skip
