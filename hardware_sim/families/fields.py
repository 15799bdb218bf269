"""Signed distances of plain solids and plane outlines, and their unions, for `contour`; negative inside.

Exact formulas after Hart (The Visual Computer 1996) and Quilez; points (..., 3), or (..., 2) in the plane.
"""

from collections.abc import Sequence

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim.implicit import Field


def sphere(radius: float) -> Field:
    """A sphere round the origin."""
    return lambda points: np.linalg.norm(points, axis=-1) - radius


def box(half: Sequence[float] | FloatArray) -> Field:
    """A box, or in the plane a rectangle, of half-lengths `half`."""

    def field(points: FloatArray) -> FloatArray:
        beyond = np.abs(points) - np.asarray(half)
        return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)

    return field


def disc(radius: float) -> Field:
    """A disc of the plane."""
    return lambda points: np.hypot(points[..., 0], points[..., 1]) - radius


def polygon(sides: int, radius: float) -> Field:
    """A regular polygon in the plane, by its incircle's radius; only a bound of the distance near its corners."""
    angle = 2 * np.pi * np.arange(sides) / sides
    outward = np.stack([np.cos(angle), np.sin(angle)])
    return lambda points: (points @ outward).max(axis=-1) - radius


def capsule(start: Sequence[float], end: Sequence[float], radius: float) -> Field:
    """All points within `radius` of a segment, in space or in the plane (a slot)."""
    origin, bone = np.asarray(start), np.asarray(end) - np.asarray(start)

    def field(points: FloatArray) -> FloatArray:
        along = np.clip((points - origin) @ bone / max(float(bone @ bone), 1e-12), 0, 1)
        return np.linalg.norm(points - origin - along[..., None] * bone, axis=-1) - radius

    return field


def cone(radius: float, height: float, top_radius: float) -> Field:
    """A frustum round z between ± `height` / 2; only a bound of the distance beyond its edges."""
    slope = (radius - top_radius) / height
    tilt = np.hypot(1.0, slope)

    def field(points: FloatArray) -> FloatArray:
        side = np.hypot(points[..., 0], points[..., 1]) - radius + slope * (points[..., 2] + height / 2)
        return np.maximum(side / tilt, np.abs(points[..., 2]) - height / 2)

    return field


def torus(radius: float, thickness: float) -> Field:
    """A ring round z."""

    def field(points: FloatArray) -> FloatArray:
        around = np.hypot(points[..., 0], points[..., 1]) - radius
        return np.hypot(around, points[..., 2]) - thickness

    return field


def prism(outline: Field, low: float, high: float, chamfer: float = 0.0) -> Field:
    """An outline of the plane between two heights, its upper edge cut at 45° by `chamfer`."""

    def field(points: FloatArray) -> FloatArray:
        side, above = outline(points[..., :2]), points[..., 2] - high
        solid = np.maximum(side, np.maximum(above, low - points[..., 2]))
        return np.maximum(solid, (side + above + chamfer) * np.sqrt(0.5)) if chamfer > 0 else solid

    return field


def moved(field: Field, place: FloatArray, rotation: FloatArray) -> Field:
    """The field of a solid rotated, then shifted; in space or in the plane."""
    return lambda points: field((points - place) @ rotation)


def smooth_minimum(first: FloatArray, second: FloatArray, width: float) -> FloatArray:
    """Minimum with a fillet where the fields differ by less than `width`; −smooth_minimum(−a, −b) rounds edges."""
    blend = np.maximum(width - np.abs(first - second), 0) / width
    return np.minimum(first, second) - blend**2 * width / 4
