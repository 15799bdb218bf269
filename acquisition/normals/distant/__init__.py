"""Normals from distant lights: from least squares for a few images to reflectance fits for many of a glossy object.

Before: a reader of capture folders, which gives an ImageSet. After: exports and report. `solve` takes blocks of rows
through one of the `methods`; `choice` picks it where nobody has.
"""

from acquisition.normals.distant.distant_solve import solve
from acquisition.normals.distant.solvers import Solver

__all__ = ["Solver", "solve"]
