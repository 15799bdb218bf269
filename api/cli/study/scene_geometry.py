"""Geometry of one simulated object under the nominal camera: samples, shadows, truth, and the dome of lights.

Tracing is expensive and depends on neither finish nor light. Each draw of an object is therefore traced once, kept for
the few draws that the parts of the study share, and used for the diffuse and the glossy version and all lights.
"""

from dataclasses import replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.capture import region
from acquisition.models import cell_config
from acquisition.models.base import BoolArray, FloatArray
from acquisition.normals import ObjectPlace
from acquisition.plan.candidate_lights import CandidateLights
from acquisition.waypoints.roadmap import dome_center, dome_lights
from hardware_sim import footprint, grade, nominal, objects, render
from hardware_sim.render import Lamp, Lens, View
from hardware_sim.tracing import Tracer
from hardware_sim.truth import Truth

PIXELS = 256
"""Width and height of the image, px. In smaller ones mixed pixels at edges dominate the mean errors at steps."""

SUBDIVISION = 3
"""Number of samples per pixel and axis."""

CACHED_GEOMETRIES = 3
"""Number of geometries that a process keeps."""

NEAR_OBJECT_PX = 2
"""Distance from the object within which table pixels are sampled like it, px, because they may look like its edge."""


class Geometry:
    """Traced geometry of one object under the nominal camera, for its diffuse and glossy versions and all lights."""

    def __init__(self, shape: str, seed: int, pixels: int = PIXELS) -> None:
        self.shape, self.seed = shape, seed
        self.cell = cell_config.load(nominal.default_cell_file())
        self.calibration = nominal.calibration(pixels)
        self.glossy = objects.build(f"{shape}-glossy", seed)
        self.tracer = Tracer(self.glossy.mesh)
        self._illuminated: dict[tuple[object, ...], list[npt.NDArray[np.uint8]]] = {}
        keep_out = self.cell.object.keep_out
        self.object_from_base = geometry.inverse(keep_out.base_from_object.matrix)
        known = self.calibration
        self.lens = Lens(
            known.width,
            known.height,
            np.array(known.camera_matrix),
            np.array(known.distortion),
            self.object_from_base @ np.array(known.base_from_camera),
        )
        self.region = region.keep_out(self.cell, known)
        self.place = ObjectPlace(
            region.middle_depth_m(self.cell, known),
            region=self.region,
            table_depth_m=region.table_depth_m(self.cell, known),
        )
        center = dome_center(self.cell, known)
        lights = dome_lights(self.cell, known, self.cell.dome.candidates)
        self.dome = CandidateLights(np.array([light.position for light in lights]), center)

    @cached_property
    def views(self) -> tuple[View, View]:
        """Samples of the image: object and surroundings finely, the rest of the region's table coarsely."""
        fine = render.trace_view(self.glossy, self.tracer, self.lens, SUBDIVISION)
        covered = np.zeros(self.region.shape, np.uint8)
        covered.ravel()[fine.surface.pixels] = 1
        size = 2 * NEAR_OBJECT_PX + 1
        near = cv2.dilate(covered, np.ones((size, size), np.uint8)).astype(bool)
        coarse = render.trace_view(self.glossy, self.tracer, self.lens, 1)
        nothing = _only(coarse.surface, np.zeros(near.shape, bool))
        return (
            replace(fine, table=_only(fine.table, near)),
            replace(coarse, surface=nothing, table=_only(coarse.table, self.region & ~near)),
        )

    def illuminated(self, key: tuple[object, ...], lamp: Lamp) -> list[tuple[BoolArray, BoolArray]]:
        """Returns which samples of each view a lamp illuminates, as `render.lit_samples`; cached as bits by `key`."""
        fine, coarse = self.views
        parts = (fine.surface, fine.table, coarse.surface, coarse.table)
        if key not in self._illuminated:
            masks = [self._surface_lit(lamp), *(self._lit(samples, lamp) for samples in parts[1:])]
            self._illuminated[key] = [np.packbits(mask) for mask in masks]
        free = [
            np.unpackbits(one, count=len(samples.pixels)).view(np.bool_)
            for one, samples in zip(self._illuminated[key], parts, strict=True)
        ]
        return [(free[0], free[1]), (free[2], free[3])]

    def _lit(self, samples: render.Samples, lamp: Lamp, chosen: np.ndarray | slice = slice(None)) -> BoolArray:
        return render.lit_mask(samples.points[chosen], samples.normals[chosen], lamp.position, self.tracer, self.glossy)

    def _surface_lit(self, lamp: Lamp) -> BoolArray:
        """Returns which samples of the object a lamp illuminates. Of a pixel's samples, shadow rays are cast only where
        its centre and the neighbouring centres differ, which classifies one sample in ten thousand differently."""
        shape = (self.lens.height, self.lens.width)
        centres, samples = self.centres, self.views[0].surface
        free = self._lit(centres, lamp)
        lit, dark = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        lit.ravel()[centres.pixels] = free
        dark.ravel()[centres.pixels] = ~free & _faces(centres, lamp)
        neighbourhood = np.ones((3, 3), np.uint8)
        bright, shadowed = (cv2.erode(one, neighbourhood).ravel()[samples.pixels] > 0 for one in (lit, dark))
        out = bright & _faces(samples, lamp)
        uncertain = np.flatnonzero(~(bright | shadowed))
        out[uncertain] = self._lit(samples, lamp, uncertain)
        return out

    @cached_property
    def centres(self) -> render.Samples:
        """Intersections of the rays through the pixel centres, object frame."""
        rows, columns = np.divmod(np.arange(self.lens.height * self.lens.width, dtype=float), self.lens.width)
        return render.object_samples(self.glossy, self.tracer, self.lens.eye, self.lens.directions(columns, rows))

    @cached_property
    def truth(self) -> Truth:
        """Ground truth at the pixel centres, view frame."""
        height, width = self.lens.height, self.lens.width
        centres = self.centres
        view_from_object = geometry.inverse(self.object_from_view)
        true_normals = np.zeros((height, width, 3), np.float32)
        depth, albedo, mask = (np.zeros((height, width), kind) for kind in (np.float32, np.float32, bool))
        true_normals.reshape(-1, 3)[centres.pixels] = geometry.rotate(view_from_object, centres.normals)
        depth.ravel()[centres.pixels] = -geometry.transform(view_from_object, centres.points)[:, 2]
        albedo.ravel()[centres.pixels] = centres.albedo
        mask.ravel()[centres.pixels] = True
        return Truth(true_normals, depth, albedo, mask)

    @cached_property
    def facing(self) -> BoolArray:
        """Pixels (H, W) within the silhouette whose surface is not seen at a grazing angle."""
        return grade.graded_pixels(self.truth, self.calibration)

    @cached_property
    def one_surface(self) -> BoolArray:
        """Pixels (H, W) that have one true normal."""
        return footprint.one_surface(self.centres, self.glossy, self.tracer, self.lens)

    @property
    def object_from_view(self) -> FloatArray:
        """Pose (4, 4) of the view frame in the object frame."""
        return self.object_from_base @ geometry.base_from_view(np.array(self.calibration.base_from_camera))


@lru_cache(maxsize=CACHED_GEOMETRIES)
def cached_geometry(shape: str, seed: int, pixels: int = PIXELS) -> Geometry:
    """Returns the geometry of one draw; the last few are cached, because the study's parts use the same ones."""
    return Geometry(shape, seed, pixels)


def _faces(samples: render.Samples, lamp: Lamp) -> BoolArray:
    """Returns which samples face a lamp."""
    to_lamp = lamp.position.astype(np.float32) - samples.points
    return np.einsum("ni,ni->n", to_lamp, samples.normals) > 0


def _only(samples: render.Samples, where: BoolArray) -> render.Samples:
    kept = where.ravel()[samples.pixels]
    return render.Samples(samples.pixels[kept], samples.points[kept], samples.normals[kept], samples.albedo[kept])
