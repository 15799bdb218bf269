"""The exports by name: each makes one file, or one folder, from a result and the images it was solved from.

They can all be made again from these two, so a service makes them when they are first asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from acquisition.normals.export import diligent, exr, lights, mesh
from acquisition.normals.export import images as pictures
from acquisition.normals.image_set import Camera, ImageSet
from acquisition.types import Float32Array, FloatArray, NormalMap


@dataclass(frozen=True)
class Source:
    """What an export is made from."""

    normal_map: NormalMap
    images: ImageSet

    @property
    def points(self) -> Float32Array:
        """The surface (3, H, W), view frame: m where the camera is calibrated, else pixels of an orthographic view."""
        depth = self.normal_map.depth
        height, width = depth.shape
        row, column = np.mgrid[:height, :width].astype(np.float32)
        if self.images.camera is None:
            return np.stack([column, -row, -depth])
        x, y = _rays(self.images.camera, height, width)
        return np.stack([x * depth, -y * depth, -depth])

    @property
    def centre(self) -> FloatArray:
        """The middle (3,) of the solved surface, view frame, in the unit of `points`."""
        mask = self.normal_map.mask
        return self.points[:, mask].sum(axis=1, dtype=np.float64) / max(np.count_nonzero(mask), 1)

    @property
    def width_m(self) -> float | None:
        """How much the image's width shows at the object; none where the camera is not calibrated."""
        camera = self.images.camera
        return None if camera is None else float(-self.centre[2] * self.images.width / camera.matrix[0, 0])


def _directx(source: Source, path: Path) -> None:
    pictures.normals_png(path, source.normal_map.normals, source.normal_map.mask, "directx")


def _exr(source: Source, path: Path) -> None:
    exr.write(path, source.normal_map)


def _mesh(source: Source, path: Path) -> None:
    unit = "pixel" if source.images.camera is None else "m"
    mesh.write(path, source.points, source.normal_map.normals, source.normal_map.mask, unit)


def _lp(source: Source, path: Path) -> None:
    lights.write_lp(path, source.images.names, lights.directions(source.images, source.centre))


def _dome(source: Source, path: Path) -> None:
    lights.write_dome(path, source.images, source.centre, source.width_m)


def _diligent(source: Source, path: Path) -> None:
    path.mkdir()
    diligent.write(path, source.images, source.centre)


def _integration(source: Source, path: Path) -> None:
    """normal_map.png, mask.png and, where the camera is calibrated, K.txt, as normal-integration tools read them."""
    path.mkdir()
    found = source.normal_map
    pictures.normals_png(path / "normal_map.png", found.normals, found.mask)
    pictures.png(path / "mask.png", found.mask.astype(np.uint8) * 255)
    if source.images.camera is not None:
        np.savetxt(path / "K.txt", source.images.camera.matrix, fmt="%.9g")


FILES: dict[str, Callable[[Source, Path], None]] = {
    "normals_directx.png": _directx,
    "maps.exr": _exr,
    "mesh.ply": _mesh,
    "lights.lp": _lp,
    "lights.dome": _dome,
}
"""Exports that are one file."""

FOLDERS: dict[str, Callable[[Source, Path], None]] = {"diligent": _diligent, "integration": _integration}
"""Exports that are a folder; over HTTP they are zip files of the same name."""


def make(name: str, source: Source, folder: Path) -> None:
    """Makes one export of `FILES` or `FOLDERS` under its name in an existing folder."""
    (FILES | FOLDERS)[name](source, folder / name)


def _rays(camera: Camera, height: int, width: int) -> Float32Array:
    """X/Z and Y/Z (2, H, W) of each pixel, OpenCV's frame, lens distortion removed."""
    row, column = np.mgrid[:height, :width].astype(np.float64)
    pixels = np.stack([column.ravel(), row.ravel()], axis=-1)[:, None, :]
    flat = cv2.undistortPoints(pixels, camera.matrix, camera.distortion)
    return np.asarray(flat.reshape(height, width, 2).transpose(2, 0, 1), np.float32)
