"""Readers of capture folders, recognised by the files in them: DiLiGenT-style, `.lp`, near light, sessions.

Each reader returns an `ImageSet` and is independent of solvers. Session folders give a `SessionCapture`, which the
session solver reads. A faulty folder is refused here, before anything is solved or written, with the name of the file.
Before: any capture. After: `normals.distant`, or `normals.solve` for near light.
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from acquisition.formats import session_files
from acquisition.formats.folders import diligent_folder, ground_truth, lp_folder, near_light_folder
from acquisition.formats.folders.ground_truth import Sphere
from acquisition.formats.folders.image_files import Progress
from acquisition.formats.folders.refusal import refusal
from acquisition.formats.folders.session_folder import SessionCapture
from acquisition.models.errors import RigError
from acquisition.normals.images.image_set import ImageSet, check

__all__ = ["Kind", "Progress", "SessionCapture", "Sphere", "kind_of", "read"]

Kind = Literal["diligent", "lp", "near", "session"]
READERS = {"diligent": diligent_folder.read, "lp": lp_folder.read}
"""Readers of folders that state light directions."""


def kind_of(folder: Path) -> Kind:
    """Returns the format of a folder or an `.lp` file. Raises RigError folder.invalid when it has none of them."""
    return _format(folder)[0]


def _format(folder: Path) -> tuple[Kind, Path]:
    """Returns the format, and the file that lists the lights."""
    if folder.suffix.lower() == ".lp" and folder.is_file():
        return "lp", folder
    if not folder.is_dir():
        raise refusal(folder, "is not a folder: name the folder that holds the images")
    if (folder / near_light_folder.LIGHTS).is_file():
        return "near", folder / near_light_folder.LIGHTS
    if session_files.is_session(folder):
        return "session", folder / session_files.MANIFEST
    if any((folder / name).is_file() for name in diligent_folder.LISTS):
        return "diligent", folder / diligent_folder.DIRECTIONS
    lp_files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".lp" and path.is_file())
    if len(lp_files) > 1:
        raise refusal(
            folder, f"holds several .lp files ({', '.join(one.name for one in lp_files)}): name the one to solve"
        )
    if lp_files:
        return "lp", lp_files[0]
    raise refusal(
        folder,
        f"holds neither {diligent_folder.DIRECTIONS} nor an .lp file nor {near_light_folder.LIGHTS} nor a session: "
        "add the file of the lights",
    )


def read(
    folder: Path, scratch: Path, *, sphere: Sphere | None = None, progress: Progress | None = None,
    full_scale: float | None = None,
) -> ImageSet:  # fmt: skip
    """Reads a DiLiGenT-style, `.lp` or near-light folder, with its ground truth.

    `scratch` is an existing folder for images that have to be decoded in full; it must exist as long as the result.
    `sphere` is a sphere in the image whose normals are the truth. For folders with directions, `full_scale` is the
    stored value that means 1.0, by default that of the type. Raises RigError folder.invalid naming the file, and
    normals.infeasible for lights that no solver can use.
    """
    kind, lights = _format(folder)
    if kind == "session":
        raise refusal(folder, "is a session folder, not a folder of images: read it with `session_folder.read`")
    own = Path(tempfile.mkdtemp(dir=scratch))  # so that one scratch folder serves several reads
    if kind == "near":
        if full_scale is not None:
            raise refusal(lights, "is where full_scale belongs: write it there, and omit --full-scale")
        images = near_light_folder.read(lights, own, progress)
    else:
        images = READERS[kind](lights, own, progress, full_scale)
    try:
        check(images)
    except RigError as error:
        raise RigError(error.code, f"{lights}: {error.detail}", **{"file": str(lights), **error.context}) from error
    if sphere is None:
        return replace(images, truth=ground_truth.read(lights.parent, images.height, images.width))
    normals, inside = ground_truth.sphere_normals(sphere, images.height, images.width, images.camera)
    graded = inside & (images.mask if images.evaluation_mask is None else images.evaluation_mask)
    if not np.any(graded):
        raise refusal(
            folder, f"the sphere {tuple(sphere)} contains no pixel of the mask: correct column, row and radius"
        )
    return replace(images, truth=normals, evaluation_mask=graded)
