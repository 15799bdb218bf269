"""Photometric stereo: images to a normal map with albedo, depth and a calibrated σ for every pixel.

Before: `capture` (all images taken so far, pilot's included). After: `plan`, which reads the normal map and says which
further lights would make it more certain, or the exports when there are none.
"""

from acquisition.normals.images.normalised_images import Images
from acquisition.normals.solve import ObjectPlace, solve, solve_stack

__all__ = ["Images", "ObjectPlace", "solve", "solve_stack"]
