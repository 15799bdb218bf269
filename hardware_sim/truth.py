"""What is true of each pixel, as a file for `grade`; it never leaves by the camera's port."""

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.errors import ErrorCode, RigError


@dataclass(frozen=True)
class Truth:
    """At the pixel centres of the true camera: normals (H, W, 3) in the nominal view frame, depth (H, W) in m along the
    nominal OpenCV z, albedo (H, W), mask (H, W) of the object; zero outside the mask."""

    normals: Float32Array
    depth: Float32Array
    albedo: Float32Array
    mask: BoolArray

    def save(self, path: Path) -> None:
        """Writes `truth.npz`; a reader never sees half of it."""
        part = path.with_suffix(".part.npz")
        np.savez(part, normals=self.normals, depth=self.depth, albedo=self.albedo, mask=self.mask)
        part.replace(path)


def load(path: Path) -> Truth:
    """Reads `truth.npz`. Raises RigError store.corrupt naming the file."""
    try:
        with np.load(path) as file:
            return Truth(file["normals"], file["depth"], file["albedo"], file["mask"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path}: is no file of truths: {error}", file=str(path)) from error
