"""Indirect part of an image: interreflections of object and table (radiosity), and the ambient light of the room.

Patches of `radiosity` exchange light, points of the image gather it from them, and pixels interpolate between these
points. The room is a sky of uniform brightness; a surface receives light from the part of it that object and table do
not cover.

Only diffuse light is reflected again, by Lambert's law. The object's albedo is multiplied by the diffuse share of its
reflectance, averaged over the hemisphere (`diffuse_share`), which is zero for a metal. Specular reflections of other
surfaces, of the table and of the room are left out.
"""

import cv2
import numpy as np
import numpy.typing as npt

from acquisition.models.base import Float32Array, FloatArray
from hardware_sim import radiosity
from hardware_sim.objects import SceneObject
from hardware_sim.reflectance import Reflectance
from hardware_sim.render import TABLE_ALBEDO, Lamp, View, lit_mask
from hardware_sim.tracing import Tracer

OBJECT_PATCHES = 2600
GATHERING_POINTS = 8000
"""Largest number of points of the image that gather light anew. Measured on the part, 512 pixels (against the path
tracer of `tests/hardware_sim/test_indirect.py`, 800 paths): the rms error of the indirect light is 0.15 of its rms,
with half the number 0.17, with twice 0.13; pixels that interpolated between the patches had 0.32."""
TABLE_RADIUS_M = 0.35
TABLE_END_M = 4.0
TABLE_CELL_PIXELS = 8

QUADRATURE = 4096
R3 = np.array([0.8191725134, 0.6710436067, 0.5497004779])
"""Number of quadrature points of `diffuse_share`, and steps of Roberts' low-discrepancy sequence in 3 dimensions."""


class IndirectLight:
    """Interreflections and ambient light of one scene as one camera sees it."""

    def __init__(self, scene: SceneObject, tracer: Tracer, view: View) -> None:
        self._scene, self._tracer, self._view = scene, tracer, view
        surface = radiosity.cluster(scene.mesh, tracer, OBJECT_PATCHES)
        table = radiosity.disc(TABLE_RADIUS_M, rings=20, sectors=40, far_m=TABLE_END_M)
        self._count = len(surface.centres)
        self._patches = radiosity.joined(surface, table)
        self._factors = radiosity.form_factors(self._patches, tracer, TABLE_END_M)
        share = diffuse_share(scene.reflectance)
        self._albedo = np.concatenate(
            [
                surface.mean(share * scene.texture(surface.points).astype(float)),
                np.full(len(table.centres), TABLE_ALBEDO),
            ]
        )
        pixels, first, number = np.unique(view.surface.pixels, return_index=True, return_inverse=True)
        self._pixels = pixels
        self._reflectance = view.share * share * np.bincount(number, view.surface.albedo).astype(np.float32)
        points, normals = view.surface.points[first].astype(float), view.surface.normals[first].astype(float)
        gathering = _lattice(pixels, view.lens.width)
        self._gathered = radiosity.gathered_factors(
            points[gathering], normals[gathering], self._patches, tracer, TABLE_END_M
        )
        self._to_pixels = radiosity.interpolation(points[gathering], normals[gathering], points, normals)
        table_share = view.share * np.bincount(view.table.pixels, minlength=view.lens.width * view.lens.height)
        self._table_reflectance = (TABLE_ALBEDO * table_share).astype(np.float32)
        self._table_grid, points = _table_grid(view)
        up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        self._to_grid = radiosity.interpolation(table.centres, table.normals, points, up)

    def interreflections(self, lamp: Lamp) -> Float32Array:
        """Image (H, W) of the lamp's light after one or more reflections, without its direct light."""
        points, normals = self._patches.points, self._patches.point_normals
        free = lit_mask(points.astype(np.float32), normals.astype(np.float32), lamp.position, self._tracer, self._scene)
        direct = self._patches.mean(lamp.irradiance(points, normals) * free)
        indirect = radiosity.indirect_irradiance(self._factors, self._albedo, direct)
        return self._image(self._gathered @ (self._albedo * (direct + indirect)), indirect[self._count :])

    def ambient(self) -> Float32Array:
        """Image (H, W) under the room's light alone, with all reflections; 1 is a white surface under open sky."""
        direct = np.clip(1 - np.asarray(self._factors.sum(axis=1), float), 0, None)
        everything = direct + radiosity.indirect_irradiance(self._factors, self._albedo, direct)
        sky = np.clip(1 - np.asarray(self._gathered.sum(axis=1), float), 0, None)
        return self._image(sky + self._gathered @ (self._albedo * everything), everything[self._count :])

    def _image(self, gathered: FloatArray, table: FloatArray) -> Float32Array:
        """Image (H, W) from the irradiance at the gathering points and on the table's patches."""
        lens = self._view.lens
        surface = self._to_pixels @ gathered.astype(np.float32)
        grid = (self._to_grid @ table).astype(np.float32).reshape(self._table_grid)
        irradiance = cv2.resize(grid, (lens.width, lens.height), interpolation=cv2.INTER_LINEAR)
        image = np.ascontiguousarray(irradiance, dtype=np.float32).ravel() * self._table_reflectance
        image[self._pixels] += self._reflectance * surface
        return image.reshape(lens.height, lens.width)


def diffuse_share(reflectance: Reflectance) -> float:
    """Bihemispherical reflectance of the diffuse part at albedo 1, by quadrature: 1 for Lambert, 0 for a metal."""
    if reflectance.kind == "lambert":
        return 1.0
    u, v, w = ((np.arange(QUADRATURE) + 0.5)[:, None] * R3 % 1.0).T  # cosine-weighted; the lamp's azimuth is 0
    to_lamp = np.stack([np.sqrt(u), np.zeros(QUADRATURE), np.sqrt(1 - u)], axis=-1)
    radius, angle = np.sqrt(v), 2 * np.pi * w
    to_eye = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - v)], axis=-1)
    up = np.broadcast_to([0.0, 0.0, 1.0], to_lamp.shape)
    return float(np.mean(reflectance.diffuse(up, to_lamp, to_eye, 1.0) / to_lamp[:, 2]))


def _lattice(pixels: npt.NDArray[np.int32], width: int) -> npt.NDArray[np.intp]:
    """Indices of those of the pixels (N,), numbers in an image of that width, that lie on a square lattice which holds
    at most GATHERING_POINTS of them; of all if none does, as of a thin wire."""
    step = int(np.ceil(np.sqrt(len(pixels) / GATHERING_POINTS)))
    rows, columns = np.divmod(pixels, width)
    chosen = np.flatnonzero((rows % step == 0) & (columns % step == 0))
    return chosen if len(chosen) else np.arange(len(pixels))


def _table_grid(view: View) -> tuple[tuple[int, int], FloatArray]:
    """Size (rows, columns) of a coarse grid over the image, and the points of the table behind it."""
    lens = view.lens
    rows, columns = -(-lens.height // TABLE_CELL_PIXELS), -(-lens.width // TABLE_CELL_PIXELS)
    down = (np.arange(rows) + 0.5) * lens.height / rows - 0.5
    right = (np.arange(columns) + 0.5) * lens.width / columns - 0.5
    directions = lens.directions(np.tile(right, rows), np.repeat(down, columns)).astype(float)
    points = lens.eye + directions * (-lens.eye[2] / directions[:, 2])[:, None]
    return (rows, columns), points
