"""Mixed pixels: those whose footprint shows two surfaces, so that they have no single true normal to be graded against.

A camera's pixel averages over its footprint, and so do the simulator's images. Where that covers the top of a step and
its wall, no number of lights determines the normal at the pixel's centre: the angle between the average and that normal
is no error of the solver and none of the lights. The rule uses the true geometry alone, never an estimate or an error:
a pixel shows one surface when none of eight points of its outline has a normal far from that of the centre or lies off
the centre's tangent plane. The angle is wide, because fine relief curves within pixels too and is to be graded. The
rims of the smallest objects need no rule of their own: grading leaves the silhouette out.
"""

import numpy as np

from acquisition.models.base import BoolArray
from hardware_sim import render
from hardware_sim.objects import SceneObject
from hardware_sim.render import Lens, Samples
from hardware_sim.tracing import Tracer

MAX_NORMAL_DEVIATION_DEG = 30.0
"""Between 25° and 40° the stepped part loses the same 6 % of its pixels and fine relief 5 % to 0.5 %."""

OUTLINE = tuple((down, right) for down in (-0.5, 0.0, 0.5) for right in (-0.5, 0.0, 0.5) if (down, right) != (0.0, 0.0))
"""Points of a pixel's outline, relative to its centre, px."""


def one_surface(centres: Samples, scene: SceneObject, tracer: Tracer, lens: Lens) -> BoolArray:
    """Pixels (H, W) whose footprint shows one smooth surface of the object; `centres` are the hits of their centres.

    A point of the outline is on the centre's surface when its normal is within `MAX_NORMAL_DEVIATION_DEG` of the
    centre's and it lies no further off the centre's tangent plane than a pixel covers there. False where the centre
    misses the object.
    """
    rows, columns = np.divmod(centres.pixels.astype(float), lens.width)
    pixel_m = np.linalg.norm(centres.points - lens.eye, axis=1) / lens.matrix[0, 0]
    single = np.ones(len(centres.pixels), dtype=np.bool_)
    for down, right in OUTLINE:
        outline = render.object_samples(scene, tracer, lens.eye, lens.directions(columns + right, rows + down))
        normals, off = np.zeros_like(centres.normals), np.full(len(single), np.inf)
        normals[outline.pixels] = outline.normals
        centre = centres.points[outline.pixels], centres.normals[outline.pixels]
        off[outline.pixels] = np.abs(np.einsum("ni,ni->n", outline.points - centre[0], centre[1]))
        single &= np.einsum("ni,ni->n", normals, centres.normals) > np.cos(np.radians(MAX_NORMAL_DEVIATION_DEG))
        single &= off < pixel_m
    out = np.zeros(lens.height * lens.width, dtype=np.bool_)
    out[centres.pixels] = single
    return out.reshape(lens.height, lens.width)
