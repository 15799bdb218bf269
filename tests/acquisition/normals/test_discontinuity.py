"""Depth discontinuities: cast shadows alone determine the height of an object above the surface behind it."""

import numpy as np

from acquisition import normals
from acquisition.models.light_plan import Light
from acquisition.models.result import SolveSettings
from acquisition.plan import baselines
from tests.acquisition import scenes

SIZE = 128
RADIUS_M, HALF_LENGTH_M, AXIS_M, PLATE_M = 0.008, 0.022, 0.022, 0.006


def rod(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (m) of the upper half of a round rod whose lower side is 8 mm above a plate."""
    beyond = np.maximum(np.abs(x) - HALF_LENGTH_M, 0)
    inside = RADIUS_M**2 - y**2 - beyond**2
    plate = np.where(x**2 + y**2 < 0.05**2, PLATE_M, 0.0)
    return np.where(inside > 0, AXIS_M + np.sqrt(np.maximum(inside, 0)), plate)


def test_solve_rod_above_plate_recovers_height_from_shadows() -> None:
    """The full rod up to its occluding contour is at the right height, not only the pixels where shadows begin."""
    true = scenes.scene(rod, scenes.calibration(SIZE))
    center = scenes.Dome(refused=0).center
    lights = [
        Light(position=tuple((center + 0.45 * unit).tolist()), axis=tuple((-unit).tolist()))
        for unit in baselines.two_rings(8, 0.2)
    ]
    observations = scenes.capture(true, lights, intensity_sigma=0, position_sigma_m=0, noisy=False)
    result = normals.solve(
        observations, true.calibration, SolveSettings(), normals.ObjectPlace(scenes.TABLE_DEPTH - 0.01)
    )
    x, y = true.points[:2]
    on_rod = (np.abs(x) < HALF_LENGTH_M) & (np.abs(y) < 0.8 * RADIUS_M)
    on_plate = (np.hypot(x, y) < 0.045) & (np.abs(y) > 0.02)
    off = true.depth - result.depth  # what is too high is positive
    off -= np.median(off[on_plate])
    rise = np.median(true.depth[on_plate]) - np.min(true.depth[on_rod])
    assert abs(np.median(off[on_rod])) < 0.12 * rise
    assert np.std(off[on_rod]) < 0.02 * rise
