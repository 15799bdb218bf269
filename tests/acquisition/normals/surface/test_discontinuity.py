"""Depth discontinuities: cast shadows alone determine the height of an object above the surface behind it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from acquisition import normals
from acquisition.models.light_plan import Light
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.normals.surface import discontinuity
from acquisition.plan import baselines
from tests.acquisition import scenes

SIZE = 96
RADIUS_M, HALF_LENGTH_M, AXIS_M, PLATE_M = 0.008, 0.022, 0.022, 0.006
DISC_RADIUS_M, DISC_HEIGHT_M = 0.015, 0.03


def rod(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (m) of the upper half of a round rod whose lower side is 8 mm above a plate."""
    beyond = np.maximum(np.abs(x) - HALF_LENGTH_M, 0)
    inside = RADIUS_M**2 - y**2 - beyond**2
    plate = np.where(x**2 + y**2 < 0.05**2, PLATE_M, 0.0)
    return np.where(inside > 0, AXIS_M + np.sqrt(np.maximum(inside, 0)), plate)


def disc(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (m) of a thick disc on a plate."""
    radius = np.hypot(x, y)
    return np.where(radius < DISC_RADIUS_M, PLATE_M + DISC_HEIGHT_M, np.where(radius < 0.05, PLATE_M, 0.0))


def slot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (m) of a block with a slot through it, as long as the block."""
    block = np.where(np.maximum(np.abs(x), np.abs(y)) < 0.045, 0.028, 0.0)
    return np.where((block > 0) & (np.abs(y) < 0.008), PLATE_M, block)


def terraces(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (m) of level terraces, 3 mm apart."""
    step = 0.003
    waves = 0.009 * (np.cos(70 * x) * np.cos(60 * y + 0.5) + 1)
    return np.where(x**2 + y**2 < 0.05**2, PLATE_M + step * np.floor(waves / step), 0.0)


def ridges(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (m) of a plate with low ridges, 30 mm apart, whose flanks have slopes of 15°."""
    across, along = (np.abs(np.mod(value + 0.03, 0.03) - 0.015) for value in (x, y))
    ridge = np.tan(np.radians(15)) * np.clip(0.004 - np.minimum(across, along), 0, 0.002)
    return np.where(x**2 + y**2 < 0.05**2, PLATE_M + ridge, 0.0)


def solved(true: scenes.Scene, units: np.ndarray) -> NormalMap:
    """Normals of a capture without errors, under lamps in the directions (F, 3)."""
    center = scenes.Dome(refused=0).center
    lights = [Light(position=tuple((center + 0.45 * unit).tolist()), axis=tuple((-unit).tolist())) for unit in units]
    observations = scenes.capture(true, lights, intensity_sigma=0, position_sigma_m=0, noisy=False)
    return normals.solve(
        observations, true.calibration, SolveSettings(), normals.ObjectPlace(scenes.TABLE_DEPTH - 0.01)
    )


def test_solve_rod_above_plate_recovers_height_from_shadows() -> None:
    """The full rod up to its occluding contour is at the right height, not only the pixels where shadows begin."""
    true = scenes.scene(rod, scenes.calibration(SIZE))
    result = solved(true, baselines.two_rings(8, 0.2))
    x, y = true.points[:2]
    on_rod = (np.abs(x) < HALF_LENGTH_M) & (np.abs(y) < 0.8 * RADIUS_M)
    on_plate = (np.hypot(x, y) < 0.045) & (np.abs(y) > 0.02)
    off = true.depth - result.depth  # what is too high is positive
    off -= np.median(off[on_plate])
    rise = np.median(true.depth[on_plate]) - np.min(true.depth[on_rod])
    assert abs(np.median(off[on_rod])) < 0.12 * rise
    assert np.std(off[on_rod]) < 0.02 * rise


def ring(count: int, slant_deg: float) -> np.ndarray:
    """Directions (count, 3) of lamps at a slant, evenly round the viewing axis."""
    azimuth, slant = np.arange(count) * 2 * np.pi / count + 0.2, np.radians(slant_deg)
    return np.stack(
        [np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.full(count, np.cos(slant))], axis=1
    )


def test_solve_disc_whose_shadows_leave_the_plate_is_as_high_as_they_say() -> None:
    """Under lamps at a slant of 63° shadows are 59 mm long, and the plate goes on for 35 mm: none has a tip on it."""
    true = scenes.scene(disc, scenes.calibration(SIZE))
    result = solved(true, ring(8, 63))
    radius = np.hypot(*true.points[:2])
    on_disc, on_plate = radius < 0.8 * DISC_RADIUS_M, (radius > 1.5 * DISC_RADIUS_M) & (radius < 0.045)
    rise = np.median(result.depth[on_plate]) - np.median(result.depth[on_disc])
    least = (0.05 - DISC_RADIUS_M) / np.tan(np.radians(63))
    assert 0.9 * least < rise < 1.1 * DISC_HEIGHT_M


def test_solve_terraces_have_the_heights_that_their_shadows_say() -> None:
    """Most shadows contradict normals that are all level no longer, once these are those of the right depth."""
    true = scenes.scene(terraces, scenes.calibration(SIZE))
    result = solved(true, ring(8, 50))
    inside = (np.hypot(*true.points[:2]) < 0.045) & result.mask
    assert np.std(result.depth[inside] - true.depth[inside]) < 0.5 * np.std(true.depth[inside])


def test_solve_plate_that_lamps_graze_is_continuous() -> None:
    """At a slant of 78° a level surface is as dark as a shadow is elsewhere, between flanks that face the lamp."""
    true = scenes.scene(ridges, scenes.calibration(SIZE))
    result = solved(true, np.concatenate([ring(4, 15), ring(4, 78)]))
    inside = (np.hypot(*true.points[:2]) < 0.045) & result.mask
    assert np.std(result.depth[inside] - true.depth[inside]) < 0.5 * np.std(true.depth[inside])


@pytest.mark.parametrize(("height", "tips_are_seen"), [(rod, True), (disc, True), (slot, False)])
def test_shadows_bound_the_depth_of_the_true_surface(
    height: Callable[[np.ndarray, np.ndarray], np.ndarray], tips_are_seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bounds hold within a pixel; equations of tips only where these are seen: a wall of a slot hides them."""
    recorded: list[discontinuity.ShadowImages] = []
    found = discontinuity.discontinuous_depth

    def recording(shadows: discontinuity.ShadowImages, *others: Any) -> Any:
        recorded.append(shadows)
        return found(shadows, *others)

    monkeypatch.setattr(discontinuity, "discontinuous_depth", recording)
    true = scenes.scene(height, scenes.calibration(SIZE))
    solved(true, ring(8, 50))

    pixels = recorded[0].pixels
    depth = true.depth.ravel()[pixels.index]
    equations = discontinuity._equations(recorded[0], depth)
    log_depth = pixels.image(np.log(depth)).ravel()
    pitch = float(np.median(np.diff(np.unique(pixels.ray[0]))))
    beyond_px = (log_depth[equations.edge] - log_depth[equations.tip] - equations.step) / pitch
    assert np.count_nonzero(equations.bound) > 100
    assert np.mean(beyond_px[equations.bound] < 1) > 0.97
    assert (np.median(np.abs(beyond_px[~equations.bound])) < 2) == tips_are_seen
