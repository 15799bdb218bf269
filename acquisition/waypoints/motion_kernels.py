# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
"""Compiled inner loop of the speed limits: how fast tool and elbow move along a straight joint segment."""

import math

import numpy as np
from numba import float64, int64, njit

from acquisition.waypoints.collision_kernels import link_frames

_vector = float64[::1]
_matrix = float64[:, ::1]


@njit(_matrix(_matrix, _matrix, _vector, _vector, int64), cache=True)
def path_lengths_per_share(starts, ends, dh, tool, samples):
    """Largest |dp/ds| (N, 2) in m of tool and elbow on N segments q(s), s from 0 to 1, at `samples` places.

    The tool is the faster of the flange and the point `tool` (3,) of the flange frame; the elbow the faster of the two
    ends of its hinge.
    """
    count = starts.shape[0]
    result = np.zeros((count, 2))
    frames = np.empty((7, 3, 4))
    joints = np.empty(6)
    point = np.empty(3)
    for n in range(count):
        for k in range(samples):
            share = k / (samples - 1)
            for j in range(6):
                joints[j] = starts[n, j] + share * (ends[n, j] - starts[n, j])
            link_frames(dh, joints, frames)
            for which in range(4):
                link = 6 if which < 2 else 2
                for row in range(3):
                    point[row] = frames[link, row, 3]
                    if which == 1:
                        point[row] += (
                            frames[6, row, 0] * tool[0] + frames[6, row, 1] * tool[1] + frames[6, row, 2] * tool[2]
                        )
                    elif which == 3:
                        point[row] += frames[2, row, 2] * dh[3]
                x, y, z = 0.0, 0.0, 0.0
                for j in range(link):  # joint j turns about the z axis of frame j
                    rate = ends[n, j] - starts[n, j]
                    ax, ay, az = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
                    rx = point[0] - frames[j, 0, 3]
                    ry = point[1] - frames[j, 1, 3]
                    rz = point[2] - frames[j, 2, 3]
                    x += rate * (ay * rz - az * ry)
                    y += rate * (az * rx - ax * rz)
                    z += rate * (ax * ry - ay * rx)
                column = 0 if which < 2 else 1
                result[n, column] = max(result[n, column], math.sqrt(x * x + y * y + z * z))
    return result
