"""Lamp poses: directions to reachable positions, patterns brought to them, tool poses to lights and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from acquisition import geometry, lamp_pose
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.scenes import Dome
from tests.acquisition.waypoints.cells import simulated_cell


def test_light_at_position_looks_at_center() -> None:
    light = lamp_pose.light_at(np.array([0.3, -0.2, -0.5]), np.array([0.0, 0.1, -0.9]))
    offset = np.array([0.0, 0.1, -0.9]) - np.array(light.position)
    np.testing.assert_allclose(np.array(light.axis) * np.linalg.norm(offset), offset, atol=1e-12)


def test_directions_are_unit_and_point_outwards() -> None:
    reach = Dome()
    units = lamp_pose.directions(reach.candidates, reach.center, 8)
    np.testing.assert_allclose(reach.center + reach.radius_m * units, reach.candidates, atol=1e-12)


@pytest.mark.parametrize("count", [0, 2, 7])
def test_directions_too_few_positions_names_both_numbers(count: int) -> None:
    reach = Dome(count=100, refused=0)
    with pytest.raises(RigError) as caught:
        lamp_pose.directions(reach.candidates[:count], reach.center, 8)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE
    assert caught.value.context == {"reachable": count, "wanted": 8}


@pytest.mark.parametrize("azimuth_deg", [0, 70, 145, 260])
def test_directions_one_half_plane_names_the_empty_side(azimuth_deg: float) -> None:
    reach = Dome(refused=0)
    toward = geometry.direction(np.pi / 2, np.radians(azimuth_deg))
    kept = reach.candidates[(reach.candidates - reach.center) @ toward < 0]
    with pytest.raises(RigError) as caught:
        lamp_pose.directions(kept, reach.center, 4)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE
    away = abs((caught.value.context["empty_azimuth_deg"] - azimuth_deg + 180) % 360 - 180)
    assert away < 10


def test_directions_non_finite_position_is_refused() -> None:
    reach = Dome()
    candidates = reach.candidates.copy()
    candidates[3, 1] = np.nan
    with pytest.raises(RigError, match=r"plan\.infeasible.*not finite"):
        lamp_pose.directions(candidates, reach.center, 4)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 8), st.integers(0, 2**31 - 1))
def test_nearest_distinct_gives_own_candidate_and_its_angle(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    units = rng.normal(size=(40, 3))
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    ideal = units[rng.permutation(40)[:count]] + 0.1 * rng.normal(size=(count, 3))
    ideal /= np.linalg.norm(ideal, axis=1, keepdims=True)
    chosen, miss = lamp_pose.nearest_distinct(ideal, units)
    assert len(set(chosen)) == count
    np.testing.assert_allclose(np.cos(miss), np.sum(ideal * units[chosen], axis=1), atol=1e-9)
    # The nearest of all pairs is settled first, so the least miss is the least there is.
    assert np.isclose(miss.min(), np.arccos(np.clip(np.max(ideal @ units.T), -1, 1)), atol=1e-9)


def test_nearest_distinct_more_ideals_than_candidates_is_refused() -> None:
    units = geometry.direction(0.5, np.arange(3.0))
    with pytest.raises(RigError, match=r"3 positions, .* only 2"):
        lamp_pose.nearest_distinct(units, units[:2])


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


def with_covariances(lamp: np.ndarray | None, camera: np.ndarray | None) -> Calibration:
    """The simulated cell's calibration with square roots (3, 3), (6, 6) of its covariances."""
    stated = {"tool_from_lamp_covariance": lamp, "base_from_camera_covariance": camera}
    covariances = {name: tuple(map(tuple, (one @ one.T).tolist())) for name, one in stated.items() if one is not None}
    return Calibration.model_validate(simulated_cell()[1].model_dump() | covariances)


def lamp_roots() -> tuple[np.ndarray, np.ndarray]:
    """Square roots of covariances of .4 mm, and of .3 mm and .5 mrad, correlated."""
    rng = np.random.default_rng(3)
    return rng.normal(0, 4e-4, (3, 3)), rng.normal(0, 1, (6, 6)) * np.repeat([3e-4, 5e-4], 3)[:, None]


def test_common_errors_covariance_equals_monte_carlo() -> None:
    """Lights of the same tool poses by calibrations drawn from the covariances scatter as `common_errors` says."""
    lamp, camera = lamp_roots()
    known = with_covariances(lamp, camera)
    rng = np.random.default_rng(4)
    poses = np.array([geometry.pose(rng.normal(0, 0.4, 3), rng.normal(0, 1, 3)) for _ in range(4)])
    draws = []
    for _ in range(4000):
        motion = camera @ rng.normal(size=6)
        tool_from_lamp = np.array(known.tool_from_lamp)
        tool_from_lamp[:3, 3] += lamp @ rng.normal(size=3)
        base_from_camera = np.array(known.base_from_camera) @ geometry.pose(motion[:3], motion[3:])
        drawn = known.model_copy(update={"tool_from_lamp": tool_from_lamp, "base_from_camera": base_from_camera})
        draws.append([lamp_pose.light_from_tool(pose, drawn).position for pose in poses])
    errors = lamp_pose.common_errors(poses, known)
    assert errors is not None
    predicted = errors.reshape(12, -1) @ errors.reshape(12, -1).T
    found = np.cov(np.array(draws).reshape(-1, 12), rowvar=False)
    scale = np.sqrt(np.diag(predicted))
    np.testing.assert_allclose(found / np.outer(scale, scale), predicted / np.outer(scale, scale), atol=0.08)


def test_common_errors_no_covariance_is_none() -> None:
    assert lamp_pose.common_errors(np.eye(4)[None], simulated_cell()[1]) is None


def test_common_direction_sigma_equals_that_of_common_errors() -> None:
    """Averaged over the rolls of the tool, which it does not know."""
    lamp, camera = lamp_roots()
    known = with_covariances(lamp, camera)
    rng = np.random.default_rng(6)
    center = np.array([0.0, 0.0, -0.9])
    poses = np.array([geometry.pose(rng.normal(0, 0.3, 3), rng.normal(0, 2, 3)) for _ in range(3000)])
    positions = np.array([lamp_pose.light_from_tool(pose, known).position for pose in poses])
    errors = lamp_pose.common_errors(poses, known)
    assert errors is not None
    offsets = positions - center
    distance = np.linalg.norm(offsets, axis=1)
    along = np.einsum("kac,ka->kc", errors, offsets / distance[:, None])
    across = (np.sum(errors**2, axis=(1, 2)) - np.sum(along**2, axis=1)) / 2 / distance**2
    sigma = lamp_pose.common_direction_sigma_rad(positions, center, known)
    assert sigma == pytest.approx(float(np.sqrt(np.mean(across))), rel=0.05)


@pytest.mark.parametrize("name", ["tool_from_lamp_covariance", "base_from_camera_covariance"])
def test_calibration_matrix_that_is_no_covariance_is_refused(name: str) -> None:
    size = 3 if name.startswith("tool") else 6
    matrix = np.eye(size)
    matrix[0, 1] = matrix[1, 0] = 2.0
    with pytest.raises(ValidationError, match=name):
        Calibration.model_validate(simulated_cell()[1].model_dump() | {name: matrix.tolist()})
