"""The search against exhaustive search, closed form and many starts; the bound against all of them."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.plan import baselines, optimise, relaxation
from acquisition.plan.baselines import two_rings
from acquisition.plan.criterion import Candidates
from tests.acquisition.plan import cases


def loss(options: Candidates, chosen: Sequence[int]) -> float:
    return options.posterior(chosen).loss


def dome_units(count: int, lowest_cosine: float = 0.0) -> FloatArray:
    cosine = np.linspace(1, lowest_cosine, count)
    return geometry.direction(np.arccos(cosine), np.arange(count) * np.pi * (3 - np.sqrt(5)))


def rings(units: FloatArray, count: int) -> list[list[int]]:
    return baselines.two_ring_completions(np.empty((0, 3)), units, count)


@pytest.mark.parametrize("seed", range(12))
def test_search_small_design_within_5_percent_of_exhaustive(seed: int) -> None:
    options = cases.random_case(seed, pixels=24, lights=11)
    chosen = optimise.search(options, rings(dome_units(11, 0.3), 3), 3, seed)
    value = loss(options, chosen)
    best = min(loss(options, some) for some in combinations(range(11), 3))
    assert len(set(chosen)) == 3
    assert best * (1 - 1e-9) <= value <= 1.05 * best


@pytest.mark.parametrize("seed", [*range(40), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(40, 200))])
def test_bound_any_subset_is_not_beaten(seed: int) -> None:
    options = cases.random_case(seed, pixels=6, lights=8)
    count = 1 + seed % 4
    bound, gap = relaxation.bound(options, count)
    best = min(loss(options, some) for some in combinations(range(8), count))
    assert bound <= best * (1 + 1e-6)
    assert gap <= 0.001


@pytest.mark.parametrize("seed", range(6))
def test_bound_noise_a_thousand_times_as_large_gives_a_thousandfold_bound(seed: int) -> None:
    """Weights are scaled to their sum before any counts as full: gradients have the unit of σ."""
    options = cases.random_case(seed, pixels=24, lights=11)
    sample = replace(options.sample, information=1e-6 * options.sample.information)
    noisy = replace(options, row=1e-3 * options.row, sample=sample)
    bound, _ = relaxation.bound(options, 3)
    noisy_bound, gap = relaxation.bound(noisy, 3)
    assert gap <= 0.001
    assert noisy_bound == pytest.approx(1e3 * bound, rel=2e-3)


@pytest.mark.parametrize("count", [3, 4, 5, 6, 8, 12])
def test_search_distant_unshadowed_lights_reaches_closed_form(count: int) -> None:
    """Unit lights, equal noise, normals of one slant at all azimuths: tr √M/√m is a lower bound of the mean σ, M the
    mean of I − n nᵀ; the relaxation attains it."""
    normal = np.ascontiguousarray(geometry.direction(np.radians(50.0), np.arange(150) * 2 * np.pi / 150).T)
    mean = np.mean(np.eye(3)[None] - normal.T[:, :, None] * normal.T[:, None, :], axis=0)
    closed = np.sum(np.sqrt(np.linalg.eigvalsh(mean))) / np.sqrt(count)
    units = dome_units(300)
    options = cases.distant_case(normal, units, scale=80.0)
    chosen = optimise.search(options, rings(units, count), count, 0)
    on_grid = loss(options, chosen) * 80.0
    assert closed * (1 - 3e-4) <= on_grid <= 1.0025 * closed
    bound, _ = relaxation.bound(options, count)
    assert bound * 80.0 == pytest.approx(closed, rel=1e-3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [4, 7])
def test_search_start_patterns_never_worse_than_any(seed: int, count: int) -> None:
    units = dome_units(60, 0.3)
    options = cases.random_case(seed, pixels=500, lights=60)
    starts = rings(units, count)
    chosen = optimise.search(options, starts, count, seed)
    value = loss(options, chosen)
    assert all(value <= loss(options, start) * (1 + 1e-6) for start in starts)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 5))])
@pytest.mark.parametrize("count", [4, 8])
def test_search_default_starts_within_1_percent_of_best_of_50(seed: int, count: int) -> None:
    units = dome_units(80, 0.3)
    options = cases.lit_case(seed, units)
    chosen = optimise.search(options, rings(units, count), count, seed)
    rng = np.random.default_rng(seed + 1000)
    starts = [[int(index) for index in rng.permutation(len(units))[:count]] for _ in range(50)]
    best = min(loss(options, optimise.exchange(options, start)) for start in starts)
    assert loss(options, chosen) <= 1.01 * best


def test_completions_captured_lights_fill_their_positions() -> None:
    units = dome_units(400, 0.2)
    pattern = two_rings(8, turn=0.3)
    captured = pattern[[0, 4, 6]]
    best = max(
        (np.min(np.max(units[added] @ pattern[[1, 2, 3, 5, 7]].T, axis=0)), added)
        for added in baselines.two_ring_completions(captured, units, 5)
    )
    assert best[0] > np.cos(0.15)
    assert len(lamp_pose.nearest_distinct(pattern, units)[0]) == 8
