"""The path tracer's images, and the solver on two small ones: the short part of the accuracy tests."""

import numpy as np
import pytest

from acquisition import normals
from acquisition.models.result import NormalMap, SolveSettings
from tests.path_traced import bench, captures

PIXELS = 64


def solved(name: str, y: np.ndarray, seed: int = 0) -> tuple[NormalMap, bench.Grade]:
    true = bench.truth(name, y.shape[-1])
    captured = captures.capture(y, bench.two_rings(len(y)), seed)
    normal_map = normals.solve_stack(
        captured.stack, captured.calibration, SolveSettings(), normals.ObjectPlace(0.9, silhouette=true.mask)
    )
    return normal_map, bench.grade(normal_map, true, captured.log_intensity)


def test_render_direct_light_equals_image_formation_model() -> None:
    """Albedo × cosine / r², at pixels that are lit and far from edges."""
    light = bench.two_rings(8)[:1]
    y = bench.render("bowl", light, pixels=PIXELS, bounces=False, samples=16)[0]
    true = bench.truth("bowl", PIXELS)
    toward = light[0] - bench.rays(PIXELS)[0] * true.depth_m[..., None]
    distance = np.linalg.norm(toward, axis=-1)
    law = 0.7 * np.sum(toward * true.normals, axis=-1) / distance * (bench.REFERENCE_M / distance) ** 2
    lit = true.graded & (y > 0.1)
    assert np.count_nonzero(lit) > 800
    assert np.median(np.abs(y[lit] / law[lit] - 1)) < 0.01


def test_solve_groove_subtracts_interreflection() -> None:
    y = bench.render("vee", bench.two_rings(8), pixels=PIXELS, bounces=True, samples=36)
    normal_map, grade = solved("vee", y)
    assert normal_map.indirect is not None
    assert 0.1 < np.median(normal_map.indirect[bench.truth("vee", PIXELS).graded]) < 0.35
    assert grade.mean_deg < 3.0
    assert grade.within_two > 0.85


def test_solve_direct_light_only_subtracts_nothing() -> None:
    y = bench.render("vee", bench.two_rings(8), pixels=PIXELS, bounces=False, samples=16)
    normal_map, grade = solved("vee", y)
    assert normal_map.indirect is not None
    assert np.all(normal_map.indirect == 0)
    assert normal_map.notes["lobe"]["strength"] == 0
    assert grade.mean_deg < 0.9
    assert grade.intensity_error < 0.01


def test_solve_glossy_object_recovers_lobe() -> None:
    lights = bench.two_rings(8)
    y = bench.render("animal", lights, pixels=48, bounces=False, samples=16)
    normal_map, grade = solved("animal", y + bench.gloss("animal", lights, pixels=48))
    assert normal_map.notes["lobe"]["strength"] == pytest.approx(0.2, abs=0.03)
    assert 12 < normal_map.notes["lobe"]["exponent"] < 60
    assert grade.mean_deg < 1.3
