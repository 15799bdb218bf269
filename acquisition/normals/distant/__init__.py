"""Photometric stereo under distant lights: least squares, robust regression and reflectance fits per pixel.

Before: a folder reader, which gives an ImageSet. After: exports and report. `distant_solve` passes blocks of
rows through one of the `solvers`; `solver_selection` chooses it by held-out lights where none was asked for.
"""

from acquisition.normals.distant.distant_solve import solve
from acquisition.normals.distant.solvers import Solver

__all__ = ["Solver", "solve"]
