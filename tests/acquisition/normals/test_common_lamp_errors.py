"""Lamps that are all displaced by one error of the calibration: its covariance lowers the error and keeps σ right."""

from dataclasses import replace

import numpy as np

from acquisition import geometry, lamp_pose, normals
from acquisition.models.base import as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.models.shot import Observations
from tests.acquisition import scenes
from tests.path_traced import bench

LAMP_SIGMA_M, OWN_SIGMA_M = 0.003, 0.0002
"""1 σ of `tool_from_lamp` per axis, which all images share, and of each image's own lamp."""


def captured(seed: int, count: int) -> tuple[scenes.Scene, Calibration, Observations]:
    """A cushion lit by two rings, all lamps displaced in the tool by the same error, at random rolls of the tool."""
    variance = LAMP_SIGMA_M**2
    known = scenes.calibration(
        64, lamp_position_sigma_m=OWN_SIGMA_M, intensity_sigma=0.005,
        tool_from_lamp_covariance=((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, variance)),
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    center = np.array([0.0, 0.0, -0.88])
    places = bench.two_rings(count) - bench.CENTER + center
    base_from_view = lamp_pose.base_from_view(known)
    positions, axes = geometry.transform(base_from_view, places), geometry.rotate(base_from_view, center - places)
    tools = lamp_pose.tool_poses(positions, axes, 8, known)[np.arange(count), rng.integers(8, size=count)]
    errors = lamp_pose.common_errors(tools, known)
    assert errors is not None
    stated = [lamp_pose.light_from_tool(tool, known) for tool in tools]
    offsets = errors @ rng.normal(size=errors.shape[2]) + rng.normal(0, OWN_SIGMA_M, (count, 3))
    lights = [
        light.model_copy(update={"position": tuple((np.array(light.position) + offset).tolist())})
        for light, offset in zip(stated, offsets, strict=True)
    ]
    true = scenes.scene(scenes.bumps, known)
    seen = scenes.capture(true, lights, seed=seed, intensity_sigma=0.005, position_sigma_m=0.0)
    shots = [
        shot.model_copy(update={"light": light, "base_from_tool": as_matrix4(tool)})
        for shot, light, tool in zip(seen.shots, stated, tools, strict=True)
    ]
    return true, known, replace(seen, shots=shots)


def test_common_covariance_lowers_error_and_keeps_sigma_right() -> None:
    """Against the same variance stated as independent from image to image."""
    rows = []
    for seed in range(3):
        true, known, observations = captured(seed, 8)
        independent = known.model_copy(
            update={
                "tool_from_lamp_covariance": None,
                "lamp_position_sigma_m": float(np.hypot(LAMP_SIGMA_M, OWN_SIGMA_M)),
            }
        )
        row = []
        for calibration in (known, independent):
            found = normals.solve(observations, calibration, SolveSettings(), normals.ObjectPlace(0.88))
            error = true.error_deg(found.normals)
            row += [error.mean(), np.sqrt(np.mean((error / found.sigma_deg[true.graded]) ** 2))]
        rows.append(row)
    error, rms, error_independent, _ = np.mean(rows, axis=0)
    assert error < 0.95 * error_independent
    assert rms < 1.6
