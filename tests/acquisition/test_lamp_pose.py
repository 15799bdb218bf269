"""Tool poses to lights and back."""

import numpy as np

from acquisition import geometry, lamp_pose
from tests.acquisition.waypoints.cells import simulated_cell


def test_tool_poses_light_from_tool_round_trips() -> None:
    _, calibration = simulated_cell()
    offset = geometry.pose((0.01, -0.02, 0.03), (0.1, 0.2, -0.3))
    tilted = calibration.model_copy(update={"tool_from_lamp": tuple(map(tuple, offset.tolist()))})
    base_from_view = lamp_pose.base_from_view(tilted)
    random = np.random.default_rng(0)
    positions, axes = random.normal(size=(20, 3)), random.normal(size=(20, 3))
    axes[0] = 0, 0, 1  # along the direction that roll is measured from
    poses = lamp_pose.tool_poses(positions, axes, 12, tilted)
    assert np.allclose(np.linalg.det(poses[..., :3, :3]), 1.0)
    for n in range(20):
        for pose in poses[n]:
            light = lamp_pose.light_from_tool(pose, tilted)
            assert np.allclose(geometry.transform(base_from_view, light.position), positions[n])
            axis = geometry.rotate(base_from_view, light.axis)
            assert np.allclose(axis, axes[n] / np.linalg.norm(axes[n]))
    assert np.abs(poses[:, 0, :3, 0] - poses[:, 1, :3, 0]).max() > 0.1  # the rolls differ
