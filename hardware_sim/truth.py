"""Ground truth of each pixel as a file for `grade`; the camera's port never sends it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast
from zipfile import BadZipFile

import numpy as np

from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.errors import ErrorCode, RigError


@dataclass(frozen=True)
class Truth:
    """Truth at the pixel centres of the true camera: normals (H, W, 3) in the nominal view frame, depth (H, W) in m
    along the nominal OpenCV z, albedo (H, W), mask (H, W) of the object; zero outside the mask. `one_surface` (H, W):
    pixels whose footprint shows one smooth surface, and so one normal (`footprint`); None if not known."""

    normals: Float32Array
    depth: Float32Array
    albedo: Float32Array
    mask: BoolArray
    one_surface: BoolArray | None = None

    def save(self, path: Path) -> None:
        """Writes `truth.npz` atomically."""
        part = path.with_suffix(".part.npz")
        single = {} if self.one_surface is None else {"one_surface": self.one_surface}
        arrays = {"normals": self.normals, "depth": self.depth, "albedo": self.albedo, "mask": self.mask, **single}
        np.savez(part, **cast(dict[str, Any], arrays))
        part.replace(path)


def load(path: Path) -> Truth:
    """Reads `truth.npz`. Raises RigError store.corrupt that names the file."""
    try:
        with np.load(path) as file:
            known = {name: file[name] for name in file.files}
        return Truth(known["normals"], known["depth"], known["albedo"], known["mask"], known.get("one_surface"))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        detail = f"{path} is not a ground-truth file: {error}"
        raise RigError(ErrorCode.STORE_CORRUPT, detail, file=str(path)) from error
