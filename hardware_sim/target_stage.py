"""Ray-traced images of a calibration target on the table, or on the flange of a moving arm.

A target is small in the image and may stand elsewhere in each one, so only the pixels round it are traced, again for
each pose. The table behind needs one ray a pixel, once. A mirror sphere shows its surroundings instead of shading: the
lamp as a bright disc, the lit table, and the room. Light that boards and planes reflect to the table and to one another
is left out; they are flat and face the sky.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.models.base import Float32Array, FloatArray
from hardware_sim import render
from hardware_sim.objects import SceneObject
from hardware_sim.render import TABLE_ALBEDO, Lamp, Lens, Samples, View, lit_mask
from hardware_sim.targets import Target
from hardware_sim.tracing import START_M, Tracer

EMITTER_RADIUS_M = 0.020
"""Radius, m, of the lamp's evenly bright window: a chip-on-board LED behind a diffuser. Shading takes it as a point."""

BLUR_PX = 0.5
"""1 σ of the lens's blur, px: corners and highlights have soft edges on a sensor."""

MARGIN_PX = 6
"""Width, px, of the margin traced round the projected target: the lens bends the target's edges by less than that."""

UP = np.array([0.0, 0.0, 1.0])

Radiance = Callable[[FloatArray, FloatArray], FloatArray]
"""Points (N, 3) on the mirror and unit directions (N, 3) away from it → radiance (N,) from there."""


@dataclass(frozen=True)
class _Posed:
    """A target at a pose: surface in the object's frame, tracer, samples, and uncovered share of each pixel (H·W,)."""

    scene: SceneObject
    tracer: Tracer
    view: View
    free: Float32Array


class _SubpixelRays:
    """Rays through points beside the pixels' centres, to first order about the centre.

    Undistortion is the most expensive part of an image, and over half a pixel it is linear to 1e-5 pixels.
    """

    def __init__(self, lens: Lens) -> None:
        rows, columns = np.divmod(np.arange(lens.width * lens.height, dtype=float), lens.width)
        self._centre = lens.directions(columns, rows)
        self._right = lens.directions(columns + 0.5, rows) - lens.directions(columns - 0.5, rows)
        self._down = lens.directions(columns, rows + 0.5) - lens.directions(columns, rows - 0.5)

    def directions(self, pixels: npt.NDArray[np.int32], right: float, down: float) -> Float32Array:
        """Directions (N, 3), as `Lens.directions`, through points `right` and `down` of the centres of pixels (N,)."""
        aside = np.float32(right) * self._right[pixels] + np.float32(down) * self._down[pixels]
        return (self._centre[pixels] + aside).astype(np.float32, copy=False)


class TargetStage:
    """Images of one target through one lens."""

    def __init__(self, target: Target, lens: Lens, subdivision: int) -> None:
        """`subdivision` × `subdivision` rays for each pixel of the target."""
        self._target, self._lens, self._subdivision = target, lens, subdivision
        self._table = _table_samples(lens)
        self._rays = _SubpixelRays(lens)
        self._last: tuple[bytes, _Posed | None] | None = None

    def lamp_image(self, lamp: Lamp, object_from_mount: FloatArray) -> Float32Array:
        """Image (H, W) of the lamp's light alone; `object_from_mount` (4, 4) is the flange's pose, or the identity."""
        posed = self._at(object_from_mount)
        points, normals = self._table.points, self._table.normals
        lit = lamp.irradiance(points.astype(float), normals.astype(float))
        if posed is None:
            return self._finished(self._on_table(lit))
        lit = lit * lit_mask(points, normals, lamp.position, posed.tracer, posed.scene)
        image = posed.free * self._on_table(lit)
        if self._target.mirror > 0:
            image += self._mirrored(posed, lambda points, away: _lamp_radiance(lamp, posed, points, away))
        else:
            image += render.direct_image(posed.view, posed.scene, posed.tracer, lamp).ravel()
        return self._finished(image)

    def ambient_image(self, object_from_mount: FloatArray) -> Float32Array:
        """Image (H, W) under the room's light alone; 1 is a white surface under open sky."""
        posed = self._at(object_from_mount)
        table = self._on_table(np.ones(len(self._table.points)))
        if posed is None:
            return self._finished(table)
        image = posed.free * table
        samples = posed.view.surface
        if self._target.mirror > 0:
            image += self._mirrored(posed, lambda _, away: np.where(away[:, 2] > 0, 1.0, TABLE_ALBEDO))
        else:
            sky = (1 + samples.normals @ UP.astype(np.float32)) / 2
            image += posed.view.share * np.bincount(samples.pixels, samples.albedo * sky, len(image)).astype(np.float32)
        return self._finished(image)

    def _at(self, object_from_mount: FloatArray) -> _Posed | None:
        """The target at a pose of its mount, cached until the pose changes; None for a target without a surface."""
        key = object_from_mount.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, self._traced(self._target.posed(object_from_mount))
        return self._last[1]

    def _traced(self, scene: SceneObject) -> _Posed | None:
        lens, corners = self._lens, scene.mesh.triangles.reshape(-1, 3)
        if not len(corners):
            return None
        tracer = Tracer(scene.mesh)
        parts = list[Samples]()
        pixels = _outlined(lens, corners)
        offsets = (np.arange(self._subdivision) + 0.5) / self._subdivision - 0.5
        for down in offsets:
            for right in offsets if len(pixels) else ():
                seen = render.object_samples(scene, tracer, lens.eye, self._rays.directions(pixels, right, down))
                parts.append(Samples(pixels[seen.pixels], seen.points, seen.normals, seen.albedo))
        share = 1.0 / self._subdivision**2
        surface = render.joined(parts) if parts else _no_samples()
        free = 1 - share * np.bincount(surface.pixels, minlength=lens.width * lens.height).astype(np.float32)
        return _Posed(scene, tracer, View(lens, share, surface, _no_samples()), free)

    def _on_table(self, irradiance: FloatArray) -> Float32Array:
        """Image (H·W,) of the table under an irradiance (N,) at its samples."""
        image = np.zeros(self._lens.width * self._lens.height, dtype=np.float32)
        image[self._table.pixels] = TABLE_ALBEDO * irradiance
        return image

    def _mirrored(self, posed: _Posed, radiance: Radiance) -> Float32Array:
        """Image (H·W,) of the mirror's reflections."""
        samples = posed.view.surface
        points, normals = samples.points.astype(float), samples.normals.astype(float)
        seen = points - self._lens.eye
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        away = seen - 2 * np.einsum("ni,ni->n", seen, normals)[:, None] * normals
        value = posed.view.share * self._target.mirror * radiance(points, away)
        return np.bincount(samples.pixels, value, len(posed.free)).astype(np.float32)

    def _finished(self, image: Float32Array) -> Float32Array:
        shaped = image.reshape(self._lens.height, self._lens.width)
        return np.asarray(cv2.GaussianBlur(shaped, (0, 0), BLUR_PX, borderType=cv2.BORDER_REPLICATE), np.float32)


def _lamp_radiance(lamp: Lamp, posed: _Posed, points: FloatArray, away: FloatArray) -> FloatArray:
    """Radiance (N,) from directions (N, 3) at points (N, 3), lamp alone: its window, the lit table, or a dark room.

    Radiance is relative to a white surface that faces the lamp on its axis at the reference distance. A window of
    radius R has (reference / R)² times its emission divided by the cosine to its axis.
    """
    facing = -(away @ lamp.axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = ((lamp.position - points) @ lamp.axis) / (away @ lamp.axis)
    at = points + np.where(np.isfinite(reach), reach, 0.0)[:, None] * away
    hit = (facing > 0) & (reach > 0) & (np.linalg.norm(at - lamp.position, axis=1) < EMITTER_RADIUS_M)
    found = np.zeros(len(points))
    brightness = lamp.power * (lamp.reference_m / EMITTER_RADIUS_M) ** 2
    found[hit] = brightness * lamp.emission(-away[hit]) / np.maximum(facing[hit], 0.05)
    down = ~hit & (away[:, 2] < -1e-6)
    place = points[down] + away[down] * (-points[down, 2] / away[down, 2])[:, None]
    place[:, 2] = 0.0
    up = np.broadcast_to(UP, place.shape)
    starts = (place + START_M * up).astype(np.float32)
    shadowed = posed.tracer.occluded(starts, lamp.position.astype(np.float32) - starts)
    found[down] = TABLE_ALBEDO * lamp.irradiance(place, up) * ~shadowed
    return found


def _table_samples(lens: Lens) -> Samples:
    """Samples of the table where the rays of the pixels' centres meet it."""
    rows, columns = np.divmod(np.arange(lens.width * lens.height, dtype=float), lens.width)
    directions = lens.directions(columns, rows).astype(float)
    pixels = np.flatnonzero(directions[:, 2] < 0).astype(np.int32)
    points = lens.eye + directions[pixels] * (-lens.eye[2] / directions[pixels, 2])[:, None]
    points[:, 2] = 0.0
    normals = np.tile(UP.astype(np.float32), (len(pixels), 1))
    albedo = np.full(len(pixels), TABLE_ALBEDO, dtype=np.float32)
    return Samples(pixels, points.astype(np.float32), normals, albedo)


def _outlined(lens: Lens, corners: FloatArray) -> npt.NDArray[np.int32]:
    """Numbers of the pixels inside and round the convex outline of points (N, 3); all if one lies behind the camera."""
    in_camera = geometry.transform(geometry.inverse(lens.object_from_camera), corners)
    if (in_camera[:, 2] <= 0.01).any():
        return np.arange(lens.width * lens.height, dtype=np.int32)
    seen = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)[0].reshape(-1, 2)
    inside = np.zeros((lens.height, lens.width), np.uint8)
    outline = cv2.convexHull(np.clip(seen, -lens.width, 2 * lens.width).round().astype(np.int32))
    cv2.fillConvexPoly(inside, outline, (1,))
    # The line widens the outline by more than distortion bends its edges.
    cv2.polylines(inside, [outline], isClosed=True, color=(1,), thickness=2 * MARGIN_PX)
    return np.flatnonzero(inside).astype(np.int32)


def _no_samples() -> Samples:
    empty = np.zeros((0, 3), np.float32)
    return Samples(np.zeros(0, np.int32), empty, empty, np.zeros(0, np.float32))
