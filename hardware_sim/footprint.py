"""Pixels whose footprint shows one surface, so that they have one true normal to compare with.

A camera's pixel averages the light of its footprint, and so do the simulator's images. If the footprint covers the top
of a step and its wall, no number of lights determines the normal at the pixel's centre. The angle between the average
and that normal is then an error neither of the solver nor of the lights. The rule uses the true geometry alone, never
an estimate or an error. Its angle is wide, because fine relief bends within pixels too and has to be graded. The rims
of small objects need no rule, because the grading that uses this mask leaves the silhouette out.
"""

import numpy as np

from acquisition.models.base import BoolArray
from hardware_sim import render
from hardware_sim.objects import SceneObject
from hardware_sim.render import Lens, Samples
from hardware_sim.tracing import Tracer

WIDEST_BEND_DEG = 30.0
"""Greatest angle between the normals of a pixel's centre and outline on one surface. Measured: between 25° and 40° the
stepped part loses the same 6 % of its pixels, and fine relief 5 % to 0.5 %."""

OUTLINE = tuple((down, right) for down in (-0.5, 0.0, 0.5) for right in (-0.5, 0.0, 0.5) if (down, right) != (0.0, 0.0))
"""Points of a pixel's outline, from its centre, pixels."""


def one_surface(seen: Samples, scene: SceneObject, tracer: Tracer, lens: Lens) -> BoolArray:
    """Mask (H, W) of the pixels whose footprint shows one smooth surface of the object; `seen` is what centres hit.

    Each of eight points of a pixel's outline must have a normal within `WIDEST_BEND_DEG` of the centre's, and be nearer
    to the centre's tangent plane than the size of a pixel there. False where the centre misses the object.
    """
    rows, columns = np.divmod(seen.pixels.astype(float), lens.width)
    pixel_m = np.linalg.norm(seen.points - lens.eye, axis=1) / lens.matrix[0, 0]
    single = np.ones(len(seen.pixels), dtype=np.bool_)
    for down, right in OUTLINE:
        there = render.object_samples(scene, tracer, lens.eye, lens.directions(columns + right, rows + down))
        normals, off = np.zeros_like(seen.normals), np.full(len(single), np.inf)
        normals[there.pixels] = there.normals
        centre = seen.points[there.pixels], seen.normals[there.pixels]
        off[there.pixels] = np.abs(np.einsum("ni,ni->n", there.points - centre[0], centre[1]))
        single &= np.einsum("ni,ni->n", normals, seen.normals) > np.cos(np.radians(WIDEST_BEND_DEG))
        single &= off < pixel_m
    out = np.zeros(lens.height * lens.width, dtype=np.bool_)
    out[seen.pixels] = single
    return out.reshape(lens.height, lens.width)
