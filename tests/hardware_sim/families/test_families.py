"""Every family: the same again for the same seed, on the table, closed as the camera sees it, normals that fit."""

import dataclasses

import numpy as np
import pytest

from hardware_sim import families
from hardware_sim.families import RandomObject, appearance
from hardware_sim.reflectance import Reflectance
from hardware_sim.tracing import Tracer


def _check(made: RandomObject) -> None:
    """What holds of every object."""
    mesh, name = made.mesh, f"{made.family} {made.seed}"
    points = mesh.triangles.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    assert np.isfinite(points).all(), name
    assert 0.07 - 1e-9 <= (high - low).max() <= 0.13 + 1e-9, name
    assert abs(low[2]) < 1e-9, name
    assert np.abs(low + high)[:2].max() < 1e-9, name
    assert 20_000 <= len(mesh.triangles) <= 300_000, (name, len(mesh.triangles))
    assert mesh.areas.min() > 1e-15, name
    assert np.allclose(np.linalg.norm(mesh.corner_normals, axis=-1), 1), name
    assert np.einsum("fci,fi->fc", mesh.corner_normals, mesh.face_normals).min() > np.cos(np.radians(60)), name
    assert _share_seen_from_behind(made) <= 3e-4, name
    albedo = made.texture(points[::7])
    assert albedo.shape == points[::7].shape[:1], name
    assert 0.05 <= albedo.min() <= albedo.max() <= 0.9, name


def _share_seen_from_behind(made: RandomObject) -> float:
    """Share of a camera's rays from 0.5 m that stop at a face which looks away from it.

    A contoured cell where more than two edges of a solid meet may fold over by a part of its size, so that it is not 0.
    """
    x, y = np.meshgrid(*[np.linspace(-0.1, 0.1, 300) + 1.2e-5] * 2)
    eye = np.array([0.01, -0.02, 0.5])
    directions = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) - eye
    origins = np.broadcast_to(eye, directions.shape)
    hits = Tracer(made.mesh).first_hits(origins.astype(np.float32), directions.astype(np.float32))
    hit = hits.triangles >= 0
    assert hit.sum() > 1000
    facing = np.einsum("ni,ni->n", made.mesh.face_normals[hits.triangles[hit]], directions[hit])
    return float((facing > 1e-9).mean())


@pytest.fixture(scope="module", params=families.NAMES)
def first(request: pytest.FixtureRequest) -> RandomObject:
    return families.make(request.param, 0)


def test_make_first_seed_holds_all_conditions(first: RandomObject) -> None:
    _check(first)


@pytest.mark.long
def test_make_same_seed_again_is_identical(first: RandomObject) -> None:
    again = families.make(first.family, 0)
    assert np.array_equal(first.mesh.triangles, again.mesh.triangles)
    assert np.array_equal(first.mesh.corner_normals, again.mesh.corner_normals)
    points = first.mesh.triangles[:, 0]
    assert np.array_equal(first.texture(points), again.texture(points))
    assert first.reflectance == again.reflectance


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("family", families.NAMES)
def test_make_forty_seeds_hold_all_conditions_and_differ(family: str) -> None:
    moments: set[bytes] = set()
    for seed in range(40):
        made = families.make(family, seed)
        _check(made)
        moments.add(np.round(np.cov(made.mesh.triangles.reshape(-1, 3).T) * 1e9).tobytes())
    assert len(moments) == 40


def test_make_unknown_family_names_those_there_are() -> None:
    with pytest.raises(ValueError, match="turned, relief"):
        families.make("statue", 1)
    with pytest.raises(ValueError, match="0 or more"):
        families.make("blob", -1)


def test_reflectance_of_ten_seeds_in_a_row_has_stated_shares() -> None:
    kinds = [appearance.reflectance_kind_of(seed) for seed in range(1007, 1017)]
    assert sorted(kinds) == sorted(["lambert"] * 4 + ["oren-nayar"] * 2 + ["ggx"] * 2 + ["metal", "scatter"])
    assert len({appearance.reflectance_kind_of(seed) for seed in range(1000, 1006)}) == 5
    pairs = {(appearance.reflectance_kind_of(seed), appearance.texture_kind_of(seed)) for seed in range(40)}
    assert len(pairs) == 20


def test_reflectance_of_seed_is_of_its_kind_within_range() -> None:
    for seed in range(200):
        drawn, kind = appearance.reflectance_of(seed), appearance.reflectance_kind_of(seed)
        assert drawn.kind == ("lambert" if kind == "scatter" else kind)
        assert (drawn.scatter_m > 0) == (kind == "scatter")
        assert Reflectance.parse(str(drawn)).kind == drawn.kind


def test_make_replaced_reflectance_keeps_the_shape() -> None:
    made = families.make("blob", 0)
    glossy = dataclasses.replace(made, reflectance=Reflectance("ggx", 0.2))
    assert glossy.mesh is made.mesh
    assert glossy.reflectance.kind == "ggx"
