# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
"""Compiled inner loop of the speed limits: path speeds of tool and elbow along a straight joint segment."""

import math

import numpy as np
from numba import float64, int64, njit

from acquisition.waypoints.collision_kernels import link_frames

_vector = float64[::1]
_matrix = float64[:, ::1]


@njit(_matrix(_matrix, _matrix, _vector, _matrix, int64), cache=True)
def path_lengths_per_share(starts, ends, dh, tool, samples):
    """Differential kinematics: largest |dp/ds| (N, 2), m, of tool and elbow on N segments q(s), s from 0 to 1.

    Evaluated at `samples` points. The tool is the fastest of the flange and the points `tool` (K, 3) of the flange
    frame; the elbow is the faster of the two ends of its hinge.
    """
    result = np.zeros((starts.shape[0], 2))
    frames = np.empty((7, 3, 4))
    joints = np.empty(6)
    hinge = np.zeros((1, 3))
    hinge[0, 2] = dh[3]
    for n in range(starts.shape[0]):
        tool_square, elbow_square = 0.0, 0.0
        for k in range(samples):
            share = k / (samples - 1)
            for j in range(6):
                joints[j] = starts[n, j] + share * (ends[n, j] - starts[n, j])
            link_frames(dh, joints, frames)
            # Velocity recursion over the links: angular (w) and linear (v) velocity, both per unit of s.
            wx, wy, wz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for j in range(6):  # joint j turns about the z axis of frame j
                rate = ends[n, j] - starts[n, j]
                wx += rate * frames[j, 0, 2]
                wy += rate * frames[j, 1, 2]
                wz += rate * frames[j, 2, 2]
                x = frames[j + 1, 0, 3] - frames[j, 0, 3]
                y = frames[j + 1, 1, 3] - frames[j, 1, 3]
                z = frames[j + 1, 2, 3] - frames[j, 2, 3]
                vx += wy * z - wz * y
                vy += wz * x - wx * z
                vz += wx * y - wy * x
                if j in (1, 5):
                    square = vx * vx + vy * vy + vz * vz
                    points = hinge if j == 1 else tool
                    for p in range(points.shape[0]):
                        x, y, z = points[p, 0], points[p, 1], points[p, 2]
                        ax = frames[j + 1, 0, 0] * x + frames[j + 1, 0, 1] * y + frames[j + 1, 0, 2] * z
                        ay = frames[j + 1, 1, 0] * x + frames[j + 1, 1, 1] * y + frames[j + 1, 1, 2] * z
                        az = frames[j + 1, 2, 0] * x + frames[j + 1, 2, 1] * y + frames[j + 1, 2, 2] * z
                        tx, ty, tz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
                        square = max(square, tx * tx + ty * ty + tz * tz)
                    if j == 1:
                        elbow_square = max(elbow_square, square)
                    else:
                        tool_square = max(tool_square, square)
        result[n, 0], result[n, 1] = math.sqrt(tool_square), math.sqrt(elbow_square)
    return result
