"""Pixels that at most one lamp reaches, in vessels seen from above, are doubtful and have a large σ; dark paint is not
mistaken for them."""

import numpy as np
import pytest

from acquisition import photometry
from tests.unseen import patterns, run, scenes, tracer
from tests.unseen.captures import capture

PIXELS = 48


def lamps_that_reach(scene: scenes.Scene, positions: np.ndarray) -> np.ndarray:
    """Number (H, W) of the lamps (F, 3) that reach the point at each pixel's centre, by ray tracing."""
    surface = tracer.Surface(scene.mesh, scene.texture)
    direction = tracer.camera_rays(scene.pixels, scene.focal_px, 1)
    hits, _ = surface.hits(np.zeros_like(direction), direction)
    out = np.zeros(scene.pixels**2, int)
    out[hits.ray] = np.sum([surface.sees(hits, lamp) for lamp in positions], axis=0)
    return out.reshape(scene.pixels, scene.pixels)


@pytest.mark.parametrize(("seed", "least"), [pytest.param(0, 80, marks=pytest.mark.long), (20, 150)])
def test_solve_pixels_in_all_shadows_are_doubtful_and_of_large_sigma(seed: int, least: int) -> None:
    scene = scenes.scene("vessel", seed, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 6, 0, 1)

    solved = run.solve(scene, capture(scene, positions))

    graded = scene.truth.within_78_deg & solved.mask
    lights = lamps_that_reach(scene, positions)
    dark, lit = graded & (lights <= 1), graded & (lights >= 3)
    assert np.count_nonzero(dark) > least
    assert np.mean(solved.doubtful[dark]) > 0.8
    assert np.mean(solved.doubtful[lit]) < 0.1
    error_deg, sigma_deg = scene.truth.error_deg(solved.normals)[dark], solved.sigma_deg[dark]
    assert np.median(sigma_deg) > 2 * photometry.SETTINGS.unchecked_sigma_deg
    assert np.median(error_deg) > 10  # otherwise a large σ would be wrong
    assert np.sqrt(np.mean((error_deg / sigma_deg) ** 2)) < 1.6


@pytest.mark.parametrize("family", [pytest.param("blob", marks=pytest.mark.long), "knot"])
def test_solve_dark_parts_of_bright_object_are_not_doubtful(family: str) -> None:
    """Two fifths of the pixels have a fifth of the others' albedo; all lamps reach most of these."""
    scene = scenes.scene(family, 63, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 8, 0, 1)

    solved = run.solve(scene, capture(scene, positions))

    lit = scene.truth.within_78_deg & solved.mask & (lamps_that_reach(scene, positions) >= 3)
    dark = lit & (solved.albedo < 0.3 * np.median(solved.albedo[solved.mask]))
    assert np.mean(dark[lit]) > 0.2
    assert np.mean(solved.doubtful[dark]) < 0.1
