"""Reflection of a glossy dielectric: against an independent formula, by its symmetry, and by finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.normals.pixels import microfacet
from hardware_sim.reflectance import Reflectance
from tests.unseen import brdf

COUNT = 400
STEP = 1e-3


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=0)


def directions(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals, lamps and cameras (3, N), each above the others' horizon."""
    rng = np.random.default_rng(seed)
    normal, lamp, view = (
        unit(rng.normal(size=(3, 4 * COUNT)) + np.array([[0], [0], [up]])).astype(np.float32) for up in (4, 1.5, 2)
    )
    seen = (np.sum(normal * lamp, axis=0) > 0.1) & (np.sum(normal * view, axis=0) > 0.1)
    chosen = np.flatnonzero(seen)[:COUNT]
    return normal[:, chosen], lamp[:, chosen], view[:, chosen]


def reflection(normal: np.ndarray, lamp: np.ndarray, view: np.ndarray, alpha: float) -> microfacet.Reflection:
    return microfacet.reflection(normal, lamp[None], view, np.ones((1, normal.shape[1]), bool), alpha)


@pytest.mark.parametrize("alpha", [0.1, 0.25, 0.5])
def test_reflection_equals_path_tracers_formula(alpha: float) -> None:
    normal, lamp, view = directions()
    found = reflection(normal, lamp, view, alpha)
    to_lamp = np.sum(normal * lamp, axis=0)
    parameters = brdf.of(Reflectance("ggx", alpha)).parameters
    columns = [np.ascontiguousarray(part.T, float) for part in (normal, view, lamp)]
    expected = to_lamp * brdf.values(parameters, np.full(len(to_lamp), 0.6), *columns)
    assert 0.6 * to_lamp * (1 + found.layer[0]) + found.lobe[0] == pytest.approx(expected, rel=1e-3, abs=1e-5)


@given(st.floats(0.05, 0.7), st.integers(0, 1000))
def test_lobe_over_cosine_is_reciprocal(alpha: float, seed: int) -> None:
    normal, lamp, view = directions(seed)
    forth = reflection(normal, lamp, view, alpha).lobe[0] / np.sum(normal * lamp, axis=0)
    back = reflection(normal, view, lamp, alpha).lobe[0] / np.sum(normal * view, axis=0)
    assert forth == pytest.approx(back, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("alpha", [0.2, 0.5])
def test_gradients_equal_finite_differences(alpha: float) -> None:
    normal, lamp, view = directions()
    found = reflection(normal, lamp, view, alpha)
    turn = STEP * unit(np.cross(normal.T, np.random.default_rng(1).normal(size=3)).T).astype(np.float32)
    forth, back = (reflection(unit(one), lamp, view, alpha) for one in (normal + turn, normal - turn))
    for name in ("lobe", "layer"):
        change = np.sum(getattr(found, f"{name}_by_normal")[0] * turn, axis=0)
        assert change == pytest.approx((getattr(forth, name) - getattr(back, name))[0] / 2, abs=2e-2 * STEP)
    wider, sharper = (reflection(normal, lamp, view, alpha * np.exp(sign * STEP)) for sign in (1, -1))
    assert found.lobe_by_log_alpha * STEP == pytest.approx((wider.lobe - sharper.lobe) / 2, abs=2e-2 * STEP)


def test_reflection_below_horizon_or_unusable_is_zero() -> None:
    normal, lamp, view = directions()
    for lamps, usable in ((-lamp, True), (lamp, False)):
        found = microfacet.reflection(normal, lamps[None], view, np.full((1, normal.shape[1]), usable), 0.3)
        assert not np.any(found.lobe)
        assert not np.any(found.layer_by_normal)
