"""The fit of σ's constants finds the constants of simulated errors, and samples of captures agree with their solves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquisition.normals.uncertainty import error_variance
from tests.unseen import run, sigma_fit
from tests.unseen.sigma_fit import Errors

WEIGHTS = np.array([0.9, 0.3, 0.09, 0.15, 0.4, 25.0])
CREASE_DEG = 12.0


def drawn(seed: int, *, added_deg: float = 0.0, unsound: bool = False) -> Errors:
    """Errors that follow Rayleigh's law with the variance of the weights."""
    rng = np.random.default_rng(seed)
    base = np.exp(rng.normal(0, 1, 3000))
    change = np.where(rng.random(3000) < 0.2, rng.uniform(0, 60, 3000) ** 2, 1.0)
    excess = np.maximum(rng.chisquare(4, 3000) / 4 - 1, 0)
    detail = np.exp(rng.normal(1, 1.5, 3000))
    line = np.where(rng.random(3000) < 0.1, rng.uniform(0, 2025, 3000), 0)
    own = (5 * rng.chisquare(5, 3000) / 5 + 1) / 6
    by_field = np.where(rng.random(3000) < 0.1, 1 / 400, 0.0)
    parts = np.stack([base, own * base * 8 * excess, own * change, own * detail, line, rng.random(3000) < 0.1])
    one = Errors("blob", seed, 8, unsound, np.zeros(3000), parts, own, by_field, np.ones(3000))
    variance = one.variance(WEIGHTS @ one.regressors(CREASE_DEG) + added_deg**2)
    return replace(one, error_deg=np.sqrt(variance * rng.exponential(1.0, 3000)), sigma_deg=np.sqrt(variance))


def test_fit_errors_of_known_weights_finds_their_ratios() -> None:
    weights, _ = sigma_fit.fit([drawn(seed) for seed in range(6)], CREASE_DEG)
    assert weights / weights[0] == pytest.approx(WEIGHTS / WEIGHTS[0], rel=0.3)


def test_fit_any_errors_scales_sigma_to_the_stated_share() -> None:
    captures = [drawn(seed) for seed in range(3)]
    weights, _ = sigma_fit.fit(captures, CREASE_DEG)
    variances = [one.variance(weights @ one.regressors(CREASE_DEG)) for one in captures]
    ratio = np.concatenate([one.error_deg / np.sqrt(v) for one, v in zip(captures, variances, strict=True)])
    assert np.mean(ratio < 1) == pytest.approx(sigma_fit.SHARE, abs=0.002)


def test_fit_without_a_component_is_less_likely() -> None:
    captures = [drawn(seed) for seed in range(3)]
    values = [sigma_fit.fit(captures, CREASE_DEG, without=number)[1] for number in range(6)]
    assert min(values) > sigma_fit.fit(captures, CREASE_DEG)[1] + 0.005


def test_summary_other_threshold_in_the_data_is_found() -> None:
    text = sigma_fit.summary([drawn(seed) for seed in range(4)] + [drawn(9, added_deg=8.0, unsound=True)])
    assert "best Δ₀ 12°" in text


def test_unsound_sigma_added_error_is_found() -> None:
    found = sigma_fit.unsound_sigma_deg([drawn(9, added_deg=8.0, unsound=True)], WEIGHTS, CREASE_DEG)
    assert found == pytest.approx(8.0, abs=1.5)


@pytest.mark.long
def test_collect_one_scene_keeps_components_of_the_solve(tmp_path: Path) -> None:
    plan = run.Plan(("blob",), (0,), (8,), ("two-rings",), 1, tmp_path)
    sigma_fit.collect(plan, tmp_path, jobs=1)
    (one,) = sigma_fit.read(tmp_path)
    by_images = error_variance.weights() @ one.regressors(error_variance.SETTINGS.min_crease_deg)
    variance = one.variance(by_images)
    assert len(one.error_deg) == sigma_fit.PIXELS
    assert one.sigma_deg == pytest.approx(np.sqrt(variance), rel=1e-3)
