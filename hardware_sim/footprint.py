"""Which pixels see one surface, so that they have a true normal to be compared with.

A camera's pixel averages what its footprint covers, and so do the simulator's pictures. Where that is the top of a step
and its wall, no light tells the normal at the pixel's centre, however many there are: the angle between the average and
that normal is no error of the solver and none of the lights. The rule asks the true geometry alone, never an estimate
or an error: the centre of the pixel and eight points of its outline see one surface when none of these has a normal far
from the centre's or lies off its tangent plane. The angle is wide, because fine relief bends within pixels too and is
to be graded. The smallest objects' rims need no rule of their own: whoever grades leaves the silhouette out.
"""

import numpy as np

from acquisition.models.base import BoolArray
from hardware_sim import render
from hardware_sim.objects import SceneObject
from hardware_sim.render import Lens, Samples
from hardware_sim.tracing import Tracer

WIDEST_BEND_DEG = 30.0
"""Between 25° and 40° the stepped part loses the same 6 % of its pixels and fine relief 5 % to 0.5 %."""

OUTLINE = tuple((down, right) for down in (-0.5, 0.0, 0.5) for right in (-0.5, 0.0, 0.5) if (down, right) != (0.0, 0.0))
"""Points of a pixel's outline, from its centre, pixels."""


def one_surface(seen: Samples, scene: SceneObject, tracer: Tracer, lens: Lens) -> BoolArray:
    """Pixels (H, W) whose footprint shows one smooth surface of the object; `seen` is what their centres hit.

    A point of the outline is on the centre's surface when its normal is within `WIDEST_BEND_DEG` of the centre's and it
    lies no further off the centre's tangent plane than a pixel covers there. False where the centre misses the object.
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
