"""Catalogue of the exports by name: each writes one file, or one folder, from a result and its images.

All exports can be made again from these, so a service makes them at the first request.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from acquisition import image_values, photometry
from acquisition.formats.export import exr, light_files, map_files, mesh
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.result import NormalMap
from acquisition.normals.images.image_set import DistantLights, ImageSet
from acquisition.normals.images.normalised_images import row_blocks

NEAR_LIGHT = (
    "The lamps stood near the object. Directions and intensities are those at its centre; away from it both differ, "
    "so a solver for distant light is wrong by degrees at the edges. Positions in mm are in lights.dome.\n"
)
MOSAIC = (
    "The images hold the sites of a mosaic sensor, one colour channel at each pixel. Solve each pixel by itself: the\n"
    "albedo of neighbours differs with their channel, so do not blur or resize.\n"
)


@dataclass(frozen=True)
class Source:
    """A result and the images that it was solved from."""

    normal_map: NormalMap
    images: ImageSet

    @property
    def solved_images(self) -> ImageSet:
        """The images with the light intensities that the solver estimated."""
        return light_files.with_estimated_intensities(self.images, self.normal_map)

    @property
    def points(self) -> Float32Array:
        """The surface (3, H, W), view frame, in the unit of the depth, which is the pixel for an orthographic view."""
        return self._points(slice(0, len(self.normal_map.depth)))

    @cached_property
    def centre(self) -> FloatArray:
        """The middle (3,) of the solved surface, view frame, in the unit of `points`."""
        mask, total = self.normal_map.mask, np.zeros(3)
        for rows in row_blocks(len(mask)):
            total += self._points(rows)[:, mask[rows]].sum(axis=1, dtype=np.float64)
        return total / max(np.count_nonzero(mask), 1)

    def _points(self, rows: slice) -> Float32Array:
        """Some rows of the surface."""
        depth, camera = self.normal_map.depth[rows], self.images.camera
        columns = slice(0, depth.shape[1])
        if camera is None:
            row, column = np.mgrid[rows, columns].astype(np.float32)
            return np.stack([column, -row, -depth])
        return photometry.points(photometry.camera_rays(camera.matrix, camera.distortion, rows, columns), depth)

    @property
    def directions(self) -> FloatArray:
        """Unit directions (F, 3), view frame, from `centre` to the lights."""
        return light_files.directions(self.images, self.centre)

    @property
    def width_m(self) -> float | None:
        """Width of the scene that the image shows at the object, m; None: it is not known."""
        camera = self.images.camera
        if camera is None or map_files.depth_unit(self.normal_map) != "m":
            return None
        return float(-self.centre[2] * self.images.width / camera.matrix[0, 0])


def _diligent(source: Source, path: Path) -> None:
    """Writes a DiLiGenT-style folder, which most photometric-stereo programs read: 001.png … (16 bits of full scale),
    filenames, directions, intensities and mask.png. The format has distant lights only: near ones are given as at the
    object's centre, and `README.txt` says so, as it does of a mosaic's sites. Merged exposures, which have values above
    full scale, are scaled down with their lights. What is not a number, outside the mask, is black."""
    path.mkdir()
    images = source.solved_images
    names = [f"{number:03d}.png" for number in range(1, images.count + 1)]
    scale = 1.0
    if images.saturated_from > 1:  # rounded, the greatest value must not count as clipped
        scale = max(scale, _greatest(images) / image_values.SATURATION_SHARE * (1 + 2 / 65535))
    for index, name in enumerate(names):
        values = np.clip(np.nan_to_num(images.values(index, 0, images.height)) / np.float32(scale), 0, 1)
        map_files.png(path / name, np.round(values * 65535).astype(np.uint16))
    (path / "filenames.txt").write_text("\n".join(names) + "\n", encoding="utf-8")
    power = np.broadcast_to(light_files.intensities(images, source.centre), (images.count, 3))
    np.savetxt(path / "light_directions.txt", source.directions, fmt="%.9f")
    np.savetxt(path / "light_intensities.txt", power / scale, fmt="%.9g")
    map_files.mask_png(path / "mask.png", images.mask)
    said = [] if isinstance(images.lights, DistantLights) else [NEAR_LIGHT]
    said += [MOSAIC] if images.channels == 1 and source.normal_map.albedo_rgb is not None else []
    if said:
        (path / "README.txt").write_text("\n".join(said), encoding="utf-8")


def _greatest(images: ImageSet) -> float:
    """Returns the greatest value within the mask, as a fraction of full scale."""
    greatest = 0.0
    for rows in row_blocks(images.height):
        inside = images.mask[rows]
        for index in range(images.count if np.any(inside) else 0):
            greatest = max(greatest, float(np.max(images.values(index, rows.start, rows.stop)[inside])))
    return greatest


def _integration(source: Source, path: Path) -> None:
    """Writes normal_map.png, mask.png and, of a calibrated camera, K.txt, as normal-integration tools read them."""
    path.mkdir()
    normal_map = source.normal_map
    map_files.normals_png(path / "normal_map.png", normal_map.normals, normal_map.mask)
    map_files.mask_png(path / "mask.png", normal_map.mask)
    if source.images.camera is not None:
        np.savetxt(path / "K.txt", source.images.camera.matrix, fmt="%.9g")


FILES: dict[str, Callable[[Source, Path], None]] = {
    "normals_directx.png": lambda source, path: map_files.normals_png(
        path, source.normal_map.normals, source.normal_map.mask, "directx"
    ),
    "maps.exr": lambda source, path: exr.write_maps(path, source.normal_map),
    "albedo.exr": lambda source, path: exr.write_albedo(path, source.normal_map),
    "albedo.png": lambda source, path: map_files.albedo_png(path, source.normal_map),
    "mesh.ply": lambda source, path: mesh.write(path, source.points, source.normal_map),
    "lights.lp": lambda source, path: light_files.write_lp(path, source.images.names, source.directions),
    "lights.dome": lambda source, path: light_files.write_dome(
        path, source.solved_images, source.centre, source.width_m
    ),
}
"""Exports that are one file."""

FOLDERS: dict[str, Callable[[Source, Path], None]] = {"diligent": _diligent, "integration": _integration}
"""Exports that are a folder; over HTTP they are zip files of the same name."""


def make(name: str, source: Source, folder: Path) -> None:
    """Makes one export of `FILES` or `FOLDERS` under its name in an existing folder."""
    (FILES | FOLDERS)[name](source, folder / name)
