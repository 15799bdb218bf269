"""The Blinn–Phong lobe fit and the derivatives of its highlight."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals import pixel_solve, specular
from acquisition.normals.pixel_solve import Estimate, PixelSolveOptions
from acquisition.normals.specular import Lobe
from tests.acquisition.normals.shared_scene import MeasuredPixels, measured


def blinn(made: MeasuredPixels, strength: float, exponent: float) -> np.ndarray:
    """k|s|(n·h)^α written out again."""
    size = np.linalg.norm(made.light, axis=1)
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)
    half = made.light / size[:, None] + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return strength * size * np.clip(np.einsum("fcn,cn->fn", half, made.normals), 0, 1) ** exponent


def fitted(made: MeasuredPixels, values: np.ndarray, off_m: float = 0.0) -> Lobe:
    noisy = values + np.random.default_rng(0).normal(0, 0.003, values.shape)
    depth_m = made.depth_m + np.float32(off_m)
    return specular.fit(made.pixels, noisy.astype(np.float32), depth_m, made.scene, specular.NO_LOBE)


@pytest.mark.parametrize(("strength", "exponent"), [(0.2, 35.0), (0.1, 25.0), (0.3, 50.0)])
def test_fit_glossy_surface_recovers_lobe(strength: float, exponent: float) -> None:
    made = measured()
    solution = fitted(made, made.values + blinn(made, strength, exponent))
    assert solution.strength == pytest.approx(strength, rel=0.1)
    assert exponent / 1.5 < solution.exponent < exponent * 1.5


@pytest.mark.parametrize("off_m", [-0.02, 0.02, 0.04])
def test_fit_flat_surface_at_wrong_depth_recovers_lobe(off_m: float) -> None:
    made = measured(count=12, largest_slant=0.1)
    solution = fitted(made, made.values + blinn(made, 0.15, 35.0), off_m)
    assert solution.strength == pytest.approx(0.15, rel=0.25)
    assert 35.0 / 1.5 < solution.exponent < 35.0 * 1.5


def test_fit_diffuse_surface_gives_no_lobe() -> None:
    made = measured()
    assert fitted(made, made.values) == specular.NO_LOBE


def test_fit_four_lights_gives_no_lobe() -> None:
    made = measured(count=4)
    assert fitted(made, made.values + blinn(made, 0.2, 35.0)) == specular.NO_LOBE


def test_derivatives_equal_finite_differences() -> None:
    """Against differences over a small rotation of g and small changes of the lobe."""
    made, gloss = measured(), Lobe(0.2, 30.0)
    solution = pixel_solve.solve(made.pixels, made.values, made.depth_m, made.scene, PixelSolveOptions(0.15))
    said = gloss.derivatives(solution, made.ray_direction)
    assert said is not None
    now = gloss.highlight(solution, made.ray_direction)
    assert said.highlight == pytest.approx(now, abs=1e-6)
    turn = np.random.default_rng(3).normal(0, 0.002, solution.g.shape).astype(np.float32)
    forth, back = (
        gloss.highlight(replace(solution, g=g), made.ray_direction) for g in (solution.g + turn, solution.g - turn)
    )
    assert np.einsum("fcn,cn->fn", said.by_g, turn) == pytest.approx((forth - back) / 2, abs=2e-4)
    stronger = Lobe(0.2 * np.exp(0.01), 30.0).highlight(solution, made.ray_direction)
    narrower = Lobe(0.2, 30.0 * np.exp(0.01)).highlight(solution, made.ray_direction)
    assert said.by_lobe[:, 0] * 0.01 == pytest.approx(stronger - now, abs=2e-5)
    assert said.by_lobe[:, 1] * 0.01 == pytest.approx(narrower - now, abs=2e-5)


def test_solve_with_highlight_derivative_halves_error() -> None:
    """Two iterations from a solve without the highlight; with the highlight held fixed the normals oscillate."""
    made, gloss = measured(), Lobe(0.4, 30.0)
    glossy = made.values + blinn(made, 0.4, 30.0).astype(np.float32)

    def error(*, together: bool) -> float:
        def solved(values: np.ndarray, highlight_by_g: np.ndarray | None) -> Estimate:
            return pixel_solve.solve(
                made.pixels, values, made.depth_m, made.scene, PixelSolveOptions(0.08), highlight_by_g=highlight_by_g
            )

        solution = solved(glossy, None)
        for _ in range(2):
            change = gloss.derivatives(solution, made.ray_direction)
            assert change is not None
            solution = solved(glossy - change.highlight, change.by_g if together else None)
        return float(np.degrees(np.mean(np.linalg.norm(solution.normals - made.normals, axis=0))))

    assert error(together=True) < 0.5 * error(together=False)
