"""Form factors and indirect irradiance against closed forms."""

import numpy as np
import pytest

from hardware_sim import objects, radiosity, sheets
from hardware_sim.sheets import Mesh
from hardware_sim.tracing import Tracer

SIDE = 0.1


def grid(corner: list[float], along: list[float], across: list[float], cells: int = 12) -> Mesh:
    """A square sheet in cells × cells parts, normal along × across."""
    steps = np.linspace(0, SIDE, cells + 1)[:, None, None]
    points = np.array(corner) + steps * np.array(along) + steps.reshape(1, -1, 1) * np.array(across)
    return sheets.sheet(points, np.broadcast_to(np.cross(along, across), points.shape))


def factor_between(first: Mesh, second: Mesh, count: int = 400) -> float:
    """F from all of one surface to all of another."""
    tracer = Tracer(sheets.joined([first, second]))
    a, b = radiosity.cluster(first, tracer, count), radiosity.cluster(second, tracer, count)
    patches = radiosity.joined(a, b)
    factors = radiosity.form_factors(patches, tracer).toarray()
    n = len(a.centres)
    return float((a.areas @ factors[:n, n:].sum(axis=1)) / a.areas.sum())


def test_form_factor_parallel_squares_matches_formula() -> None:
    floor = grid([0, 0, 0], [1, 0, 0], [0, 1, 0])
    ceiling = grid([0, 0, SIDE], [0, 1, 0], [1, 0, 0])
    assert factor_between(floor, ceiling) == pytest.approx(0.19982, rel=0.01)


def test_form_factor_perpendicular_squares_matches_formula() -> None:
    floor = grid([0, 0, 0], [1, 0, 0], [0, 1, 0])
    wall = grid([0, 0, 0], [0, 1, 0], [0, 0, 1])
    assert factor_between(floor, wall) == pytest.approx(0.20004, rel=0.03)


def test_form_factor_wall_between_squares_is_zero() -> None:
    floor = grid([0, 0, 0], [1, 0, 0], [0, 1, 0])
    ceiling = grid([0, 0, SIDE], [0, 1, 0], [1, 0, 0])
    between = sheets.box((-0.1, -0.1, 0.045), (0.2, 0.2, 0.055))
    tracer = Tracer(sheets.joined([floor, ceiling, between]))
    a, b, c = (radiosity.cluster(mesh, tracer, 100) for mesh in (floor, ceiling, between))
    factors = radiosity.form_factors(radiosity.joined(radiosity.joined(a, b), c), tracer).toarray()
    assert factors[:100, 100:200].sum() == factors[100:200, :100].sum() == 0
    assert factors[:100, 200:].sum(axis=1).mean() > 0.8


@pytest.fixture(scope="module")
def cavity() -> tuple[radiosity.Patches, np.ndarray]:
    """The inside of a sphere."""
    grids = [sheets.sheet(0.05 * unit, -unit) for unit in sheets.cube_directions(40)]
    mesh = sheets.joined(grids)
    tracer = Tracer(mesh)
    patches = radiosity.cluster(mesh, tracer, 900)
    return patches, radiosity.form_factors(patches, tracer).toarray()


def test_form_factors_closed_cavity_sum_to_one(cavity: tuple[radiosity.Patches, np.ndarray]) -> None:
    """Inside a sphere every patch sees every region in proportion to its area, and all of them fill the hemisphere."""
    patches, factors = cavity
    assert factors.sum(axis=1) == pytest.approx(1.0, abs=1e-5)
    for direction in ([1, 0, 0], [0, -1, 0], [0, 0, 1]):
        region = patches.centres @ direction > 0.02
        share = patches.areas[region].sum() / patches.areas.sum()
        assert factors[:, region].sum(axis=1) == pytest.approx(share, abs=0.06)
        assert factors[:, region].sum(axis=1).mean() == pytest.approx(share, abs=0.005)


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_indirect_irradiance_integrating_sphere_has_its_gain(
    cavity: tuple[radiosity.Patches, np.ndarray], albedo: float
) -> None:
    """Light E on every patch of a sphere of albedo ρ becomes E / (1 − ρ) in all."""
    patches, factors = cavity
    count = len(patches.centres)
    indirect = radiosity.indirect_irradiance(factors, np.full(count, albedo), np.ones(count))
    assert indirect.mean() == pytest.approx(albedo / (1 - albedo), rel=0.002)


def test_form_factors_are_reciprocal(cavity: tuple[radiosity.Patches, np.ndarray]) -> None:
    patches, factors = cavity
    one, other = patches.centres[:, 0] > 0.025, patches.centres[:, 1] < -0.01
    forth = patches.areas[one] @ factors[np.ix_(one, other)].sum(axis=1)
    back = patches.areas[other] @ factors[np.ix_(other, one)].sum(axis=1)
    assert forth == pytest.approx(back, rel=0.02)


def test_cluster_patches_cover_surface_once() -> None:
    mesh = sheets.box((-0.05, -0.03, 0.0), (0.05, 0.03, 0.04))
    patches = radiosity.cluster(mesh, Tracer(mesh), 600)
    assert patches.areas.sum() == pytest.approx(mesh.areas.sum(), rel=1e-9)
    top = patches.normals[:, 2] > 0.99
    assert patches.areas[top].sum() == pytest.approx(0.1 * 0.06, rel=0.03)
    assert np.abs(patches.normals).max(axis=1).min() > 0.7
    assert radiosity.disc(0.2, 10, 24, 1.0).areas.sum() == pytest.approx(np.pi)


def test_interpolation_keeps_constants_and_is_smooth() -> None:
    mesh = grid([0, 0, 0], [1, 0, 0], [0, 1, 0])
    patches = radiosity.cluster(mesh, Tracer(mesh), 400)
    x = np.linspace(0.02, 0.08, 2000)
    points = np.stack([x, np.full_like(x, 0.05), np.zeros_like(x)], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    matrix = radiosity.interpolation(patches.centres, patches.normals, points, up)
    assert matrix @ np.ones(len(patches.centres)) == pytest.approx(1.0, abs=1e-5)
    ramp = matrix @ patches.centres[:, 0]
    assert np.abs(ramp - x).max() < 0.004
    assert np.abs(np.diff(ramp)).max() < 0.0006  # twenty times the step, a fraction of a patch


def test_exposed_buried_faces_are_excluded() -> None:
    """What a part of overlapping solids shows from above covers its footprint, 126 mm × 88 mm, exactly once."""
    mesh = objects.build("part", 1).mesh
    patches = radiosity.cluster(mesh, Tracer(mesh), 2000)
    up = np.clip(patches.point_normals[:, 2], 0, None)
    per_point = patches.areas.sum() / len(patches.points)
    assert up.sum() * per_point == pytest.approx(0.126 * 0.088, rel=0.01)
    down = np.clip(-patches.point_normals[:, 2], 0, None)
    assert down.sum() * per_point == pytest.approx(0.126 * 0.088, rel=0.01)
