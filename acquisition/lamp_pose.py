"""From tool poses to lights and back: where the lamp is when the arm says where its tool is.

Lives below the stages because two of them need it: capture logs the light that was measured, waypoints looks for the
tool pose that puts the lamp where the plan wants it.
"""

import numpy as np

from acquisition import geometry
from acquisition.measured import Calibration
from acquisition.types import FloatArray, Light


def light_from_tool(base_from_tool: FloatArray, calibration: Calibration) -> Light:
    """The light, in the view frame, of a tool pose (4, 4) as the controller measured it."""
    view_from_base = geometry.inverse(base_from_view(calibration))
    view_from_lamp = view_from_base @ base_from_tool @ np.array(calibration.tool_from_lamp)
    x, y, z = view_from_lamp[:3, 3].tolist()
    u, v, w = view_from_lamp[:3, 2].tolist()
    return Light(position=(x, y, z), axis=(u, v, w))


def base_from_view(calibration: Calibration) -> FloatArray:
    """The view frame's pose (4, 4) in the arm's base frame."""
    return geometry.base_from_view(np.array(calibration.base_from_camera))


def tool_poses(positions: FloatArray, axes: FloatArray, rolls: int, calibration: Calibration) -> FloatArray:
    """Tool poses (N, rolls, 4, 4) that put the lamp at positions (N, 3) looking along axes (N, 3), all in base.

    The lamp is round, so the roll about its axis is free; `rolls` equal steps of it are given.
    """
    z = axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    aside = np.where(np.abs(z[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(aside, z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    y = np.cross(z, x)
    angles = np.arange(rolls) * (2 * np.pi / rolls)
    cosine, sine = np.cos(angles)[None, :, None], np.sin(angles)[None, :, None]
    base_from_lamp = np.zeros((len(positions), rolls, 4, 4))
    base_from_lamp[..., :3, 0] = cosine * x[:, None] + sine * y[:, None]
    base_from_lamp[..., :3, 1] = cosine * y[:, None] - sine * x[:, None]
    base_from_lamp[..., :3, 2] = z[:, None]
    base_from_lamp[..., :3, 3] = positions[:, None]
    base_from_lamp[..., 3, 3] = 1.0
    return base_from_lamp @ geometry.inverse(np.array(calibration.tool_from_lamp))
