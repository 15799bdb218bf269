"""The lobe that all pixels find together."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals import pixel_solve, specular
from acquisition.normals.pixel_solve import Estimate
from acquisition.normals.specular import Lobe
from tests.acquisition.normals.shared_scene import Measured, measured


def blinn(scene: Measured, strength: float, exponent: float) -> np.ndarray:
    """k|s|(n·h)^α written out again."""
    size = np.linalg.norm(scene.light, axis=1)
    view = -scene.along / np.linalg.norm(scene.along, axis=0)
    half = scene.light / size[:, None] + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return strength * size * np.clip(np.einsum("fcn,cn->fn", half, scene.normals), 0, 1) ** exponent


def fitted(scene: Measured, values: np.ndarray, off_m: float = 0.0) -> Lobe:
    noisy = values + np.random.default_rng(0).normal(0, 0.003, values.shape)
    depth_m = scene.depth_m + np.float32(off_m)
    return specular.fit(
        scene.pixels, noisy.astype(np.float32), depth_m, scene.along, scene.lamp, scene.calibration, scene.noise, 0.15,
        specular.NO_LOBE,
    )  # fmt: skip


@pytest.mark.parametrize(("strength", "exponent"), [(0.2, 35.0), (0.1, 25.0), (0.3, 50.0)])
def test_a_lobe_is_found(strength: float, exponent: float) -> None:
    scene = measured()
    found = fitted(scene, scene.values + blinn(scene, strength, exponent))
    assert found.strength == pytest.approx(strength, rel=0.1)
    assert exponent / 1.5 < found.exponent < exponent * 1.5


@pytest.mark.parametrize("off_m", [-0.02, 0.02, 0.04])
def test_the_lobe_of_a_flat_surface_is_found_although_its_depth_is_wrong(off_m: float) -> None:
    scene = measured(count=12, largest_slant=0.1)
    found = fitted(scene, scene.values + blinn(scene, 0.15, 35.0), off_m)
    assert found.strength == pytest.approx(0.15, rel=0.25)
    assert 35.0 / 1.5 < found.exponent < 35.0 * 1.5


def test_a_matt_surface_gets_none() -> None:
    scene = measured()
    assert fitted(scene, scene.values) == specular.NO_LOBE


def test_four_lights_cannot_tell() -> None:
    scene = measured(count=4)
    assert fitted(scene, scene.values + blinn(scene, 0.2, 35.0)) == specular.NO_LOBE


def test_the_highlight_changes_as_it_is_said_to() -> None:
    """Against differences over a small turn of g and small changes of the lobe."""
    scene, gloss = measured(), Lobe(0.2, 30.0)
    found = pixel_solve.solve(
        scene.pixels, scene.values, scene.depth_m, scene.lamp, scene.calibration, scene.noise, threshold=0.15
    )
    said = gloss.derivatives(found, scene.along)
    assert said is not None
    now = gloss.highlight(found, scene.along)
    assert said.highlight == pytest.approx(now, abs=1e-6)
    turn = np.random.default_rng(3).normal(0, 0.002, found.g.shape).astype(np.float32)
    there, back = (gloss.highlight(replace(found, g=g), scene.along) for g in (found.g + turn, found.g - turn))
    assert np.einsum("fcn,cn->fn", said.by_g, turn) == pytest.approx((there - back) / 2, abs=2e-4)
    stronger = Lobe(0.2 * np.exp(0.01), 30.0).highlight(found, scene.along)
    narrower = Lobe(0.2, 30.0 * np.exp(0.01)).highlight(found, scene.along)
    assert said.by_lobe[:, 0] * 0.01 == pytest.approx(stronger - now, abs=2e-5)
    assert said.by_lobe[:, 1] * 0.01 == pytest.approx(narrower - now, abs=2e-5)


def test_a_strong_highlight_is_taken_out_with_the_normal_that_it_depends_on() -> None:
    """Two turns from a solve that knows nothing of it; taken as fixed, the highlight throws normals to and fro."""
    scene, gloss = measured(), Lobe(0.4, 30.0)
    glossy = scene.values + blinn(scene, 0.4, 30.0).astype(np.float32)

    def error(*, together: bool) -> float:
        def solved(values: np.ndarray, highlight_by_g: np.ndarray | None) -> Estimate:
            return pixel_solve.solve(
                scene.pixels, values, scene.depth_m, scene.lamp, scene.calibration, scene.noise, threshold=0.08,
                highlight_by_g=highlight_by_g,
            )  # fmt: skip

        found = solved(glossy, None)
        for _ in range(2):
            change = gloss.derivatives(found, scene.along)
            assert change is not None
            found = solved(glossy - change.highlight, change.by_g if together else None)
        return float(np.degrees(np.mean(np.linalg.norm(found.normals - scene.normals, axis=0))))

    assert error(together=True) < 0.5 * error(together=False)
