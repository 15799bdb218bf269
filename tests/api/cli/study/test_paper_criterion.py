"""The paper's criterion: the closed-form bound, the search that reaches it, and the gradients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from api.cli.study import paper_criterion


def projector(seed: int, flat: float = 1.0) -> np.ndarray:
    """M of random normals of an upper half space, the smaller `flat` the more they face the camera."""
    normal = np.random.default_rng(seed).normal(size=(300, 3)) * (flat, flat, 1)
    normal[:, 2] = np.abs(normal[:, 2])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.eye(3) - normal.T @ normal / len(normal)


@given(st.integers(0, 10_000), st.integers(3, 9), st.floats(0.1, 2))
@settings(max_examples=50, deadline=None)
def test_lower_bound_random_unit_lights_are_not_below(seed: int, count: int, flat: float) -> None:
    lights = np.random.default_rng(seed).normal(size=(2000, count, 3))
    lights /= np.linalg.norm(lights, axis=-1, keepdims=True)
    weight = projector(seed, flat)
    values = paper_criterion.phi(lights, weight)
    assert np.min(values) >= paper_criterion.lower_bound(weight, count) * (1 - 1e-9)
    direct = np.trace(weight @ np.linalg.inv(lights[0].T @ lights[0]))
    assert values[0] == pytest.approx(direct, rel=1e-6)


@pytest.mark.parametrize("count", range(3, 13))
def test_best_unit_lights_reach_lower_bound(count: int) -> None:
    weight = projector(count)
    lights = paper_criterion.best_unit_lights(weight, count, seed=1, starts=4)
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), 1, atol=1e-12)
    assert np.all(lights[:, 2] >= 0)
    assert paper_criterion.phi(lights, weight) == pytest.approx(paper_criterion.lower_bound(weight, count), rel=1e-3)


def test_errata_agree_with_numerical_checks() -> None:
    errata = paper_criterion.errata(projector(1), seed=1, triples=20_000)
    assert errata.idempotence["1"] < 1e-12
    assert errata.idempotence["0.5"] == pytest.approx(1.0)
    assert all(value < 1e-12 for value in errata.scaled_idempotence.values())
    assert errata.gradient_error < 1e-3
    assert 0.5 < errata.matrix_product_cosine < 0.99
    values = [value for _, value, _ in errata.literal]
    lengths = [length for *_, length in errata.literal]
    assert values == sorted(values, reverse=True)
    assert lengths == sorted(lengths)
    assert values[-1] < paper_criterion.lower_bound(projector(1), 3) / 10  # far below what unit lights can reach
    assert errata.single_normal_bound == pytest.approx(4 / 3)
    assert errata.single_normal_random > errata.single_normal_bound


def test_phi_coplanar_lights_is_infinite() -> None:
    flat = np.array([[1.0, 0, 0], [0, 1, 0], [0.6, 0.8, 0]])
    assert paper_criterion.phi(flat, projector(1)) == np.inf
