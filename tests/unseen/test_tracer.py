"""The path tracer against closed forms: the point light's law, a closed cavity, and the mean of its own sampling."""

import numpy as np
import pytest

from hardware_sim import sheets
from hardware_sim.reflectance import Reflectance
from hardware_sim.sheets import Mesh
from tests.unseen import brdf, tracer
from tests.unseen.brdf import Brdf
from tests.unseen.tracer import Lamp, Tracer

REFERENCE_M = 0.4


def ball(radius_m: float, center: np.ndarray, *, inward: bool = False) -> Mesh:
    sign = -1.0 if inward else 1.0
    sides = [sheets.sheet(center + radius_m * grid, sign * grid) for grid in sheets.cube_directions(64)]
    return sheets.joined(sides)


def constant(albedo: float) -> tracer.Texture:
    return lambda points: np.full(len(points), albedo)


def lit_by_hand(point: np.ndarray, normal: np.ndarray, lamp: np.ndarray, albedo: float) -> np.ndarray:
    away = lamp - point
    r = np.linalg.norm(away, axis=-1)
    return albedo * np.maximum(np.sum(normal * away, axis=-1) / r, 0) * (REFERENCE_M / r) ** 2


def test_direct_light_on_a_plane_is_the_analytic_law() -> None:
    plane = sheets.quad((-0.5, -0.5, -0.6), (0.5, -0.5, -0.6), (0.5, 0.5, -0.6), (-0.5, 0.5, -0.6))
    made = Tracer(
        plane, constant(0.5), Brdf(), pixels=16, focal_px=40.0, samples=1, reference_m=REFERENCE_M, indirect=False
    )
    lamp = np.array([0.1, -0.05, -0.3])
    point = 0.6 * tracer.camera_rays(16, 40.0, 1)
    expected = lit_by_hand(point, np.array([0.0, 0.0, 1.0]), lamp, 0.5)
    # Corners are single precision: 0.6 m to 4e-8.
    np.testing.assert_allclose(made.render(Lamp(lamp, np.array([0, 0, -1.0]))).ravel(), expected, rtol=2e-5)


def test_direct_light_on_a_ball_is_the_analytic_law_and_shadowed() -> None:
    center = np.array([0.0, 0.0, -0.5])
    made = Tracer(
        ball(0.05, center), constant(0.8), Brdf(), pixels=32, focal_px=120.0, samples=1, reference_m=REFERENCE_M,
        indirect=False,
    )  # fmt: skip
    lamp = center + np.array([0.3, 0.1, 0.05])
    ray = tracer.camera_rays(32, 120.0, 1)
    half = ray @ center / np.sum(ray**2, axis=1)
    inside = half**2 - (center @ center - 0.05**2) / np.sum(ray**2, axis=1)
    point = (half - np.sqrt(np.maximum(inside, 0)))[:, None] * ray
    expected = np.where(inside > 0, lit_by_hand(point, (point - center) / 0.05, lamp, 0.8), 0)
    rendered = made.render(Lamp(lamp, np.array([-1.0, 0, 0]))).ravel()
    middle = inside > 0.2 * inside.max()
    # 64 facets a quarter turn: the surface is within 3e-5 of the radius, and its own shadow edge within 1/64 rad.
    np.testing.assert_allclose(rendered[middle], expected[middle], atol=0.02)
    assert np.mean(np.abs(rendered - expected)[middle]) < 1e-3


def test_lobe_falls_to_half_at_its_half_angle() -> None:
    lobe = np.array([np.radians(30), 0.4])
    assert brdf.falloff(lobe, 1.0) == pytest.approx(1.0)
    assert brdf.falloff(lobe, float(np.cos(np.radians(30)))) == pytest.approx(0.5)
    assert brdf.falloff(np.zeros(2), 0.2) == 1.0


def test_radiosity_of_a_closed_cavity_is_the_geometric_series(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracer, "POINTS", 1500)
    monkeypatch.setattr(tracer, "DIFFUSE_RAYS", 64)
    radius, albedo = 0.2, 0.5
    made = Tracer(
        ball(radius, np.zeros(3), inward=True), constant(albedo), Brdf(), pixels=12, focal_px=12.0, samples=1,
        reference_m=REFERENCE_M,
    )  # fmt: skip
    # A lamp at the middle lights every wall alike: B = ρ E / (1 − ρ); bounces beyond the tenth leave 0.1 %.
    expected = albedo * (REFERENCE_M / radius) ** 2 / (1 - albedo)
    rendered = made.render(Lamp(np.zeros(3), np.array([0, 0, -1.0])))
    assert np.mean(rendered) == pytest.approx(expected, rel=0.005)
    np.testing.assert_allclose(rendered, expected, rtol=0.03)  # the wall's facets


@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.6])
def test_lobe_sampling_has_the_mean_of_the_lobe(alpha: float) -> None:
    rng = np.random.default_rng(0)
    count = 200_000
    lobe = Brdf(diffuse=0.0, alpha=alpha, f0=0.5, f90=1.0)
    normal = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
    outward = np.broadcast_to([np.sin(0.8), 0.0, np.cos(0.8)], (count, 3))
    _, weight = brdf.reflected(lobe, np.ones(count), normal, outward, rng.random((count, 2)))
    inward = brdf.cosine_directions(rng.random((count, 2)))
    values = brdf.values(lobe.parameters, np.ones(count), normal, outward, inward)
    assert np.mean(weight) == pytest.approx(np.mean(values), abs=4 * np.std(values) / count**0.5)


@pytest.mark.parametrize("text", ["lambert", "oren-nayar:0.35", "ggx:0.2", "metal:0.3"])
def test_reflectance_values_are_those_of_the_simulator(text: str) -> None:
    """The simulator's formulas are independent of the tracer's and must agree with them."""
    rng = np.random.default_rng(1)
    reflectance = Reflectance.parse(text)
    normal, one, other = (brdf.cosine_directions(rng.random((500, 2))) for _ in range(3))
    albedo = rng.uniform(0.1, 0.9, 500)
    cosine = np.maximum(np.sum(normal * one, axis=1), 0)
    ours = brdf.values(brdf.of(reflectance).parameters, albedo, normal, other, one) * cosine
    np.testing.assert_allclose(ours, reflectance.value(normal, one, other, albedo), rtol=1e-6, atol=1e-6)


def test_subsurface_scatter_softens_a_shadow_edge() -> None:
    plane = sheets.quad((-0.1, -0.1, -0.5), (0.1, -0.1, -0.5), (0.1, 0.1, -0.5), (-0.1, 0.1, -0.5))
    wall = sheets.quad((0.0, -0.1, -0.5), (0.0, 0.1, -0.5), (0.0, 0.1, -0.47), (0.0, -0.1, -0.47))
    lamp = Lamp(np.array([0.15, 0.0, -0.3]), np.array([0, 0, -1.0]))
    hard, soft = (
        Tracer(
            sheets.joined([plane, wall]), constant(0.5), Brdf(), pixels=48, focal_px=200.0, samples=4,
            reference_m=REFERENCE_M, indirect=False, scatter_m=scatter,
        ).render(lamp)
        for scatter in (0.0, 0.005)
    )  # fmt: skip
    steepest = [np.max(np.abs(np.diff(image[18:30, 4:20].mean(axis=0)))) for image in (hard, soft)]  # left of the wall
    assert steepest[1] < 0.7 * steepest[0]
    assert np.mean(soft) == pytest.approx(np.mean(hard), rel=0.02)  # light goes elsewhere, none is lost
