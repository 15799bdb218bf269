from pathlib import Path

import numpy as np
import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import objects
from hardware_sim.objects import SceneObject

REPOSITORY = Path(__file__).parents[2]


SLOW = ("relief", "figure")
"""Shapes whose surface takes seconds to build."""


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.long if name in SLOW else ()) for name in objects.SHAPES],
)
def scene(request: pytest.FixtureRequest) -> SceneObject:
    return objects.build(request.param, 1)


def test_build_object_stands_on_table_inside_keep_out(scene: SceneObject) -> None:
    keep_out = cell_config.load(REPOSITORY / "hardware_sim" / "cells" / "cell.sim.toml").object.keep_out
    assert scene.radius_m < keep_out.radius_m - 0.004
    assert scene.height_m < keep_out.height_m - 0.004
    assert abs(scene.mesh.triangles[..., 2].min()) < 1e-9
    points = scene.mesh.triangles.reshape(-1, 3)[::7]
    span = max(np.ptp(points[:, :2] @ [np.cos(a), np.sin(a)]) for a in np.linspace(0, np.pi, 90))
    assert 0.09 < span < 0.155


def test_build_faces_agree_with_normals(scene: SceneObject) -> None:
    assert np.allclose(np.linalg.norm(scene.mesh.corner_normals, axis=-1), 1)
    cosine = np.einsum("fci,fi->fc", scene.mesh.corner_normals, scene.mesh.face_normals)
    assert np.percentile(cosine, 0.5) > np.cos(np.radians(25))


def test_build_camera_sees_no_inside_face(scene: SceneObject) -> None:
    """From straight above, every ray stops at a face that looks up: the surface is closed from there."""
    from hardware_sim.tracing import Tracer

    x, y = np.meshgrid(*[np.linspace(-0.08, 0.08, 700)] * 2)
    origins = np.stack([x, y, np.full_like(x, 0.5)], axis=-1).reshape(-1, 3).astype(np.float32)
    down = np.tile(np.array([0, 0, -1], dtype=np.float32), (len(origins), 1))
    hits = Tracer(scene.mesh).first_hits(origins, down)
    visible = hits.triangles[hits.triangles >= 0]
    assert len(visible) > 20_000
    assert (scene.mesh.face_normals[visible, 2] > -1e-6).mean() > 0.9999


@pytest.mark.parametrize("name", ["sphere", "vase", "bumps"])
def test_build_mesh_is_watertight(name: str) -> None:
    """Every edge is walked once in each direction."""
    mesh = objects.build(name, 2).mesh
    corners = np.rint(mesh.triangles.reshape(-1, 3) * 1e8).astype(np.int64) + 2**30
    key = (corners[:, 0] << 31 ^ corners[:, 1] * 0x9E3779B1 ^ corners[:, 2] * 0x85EBCA77 << 7).reshape(-1, 3)
    forth = np.concatenate([key[:, a] * 31 + key[:, b] for a, b in ((0, 1), (1, 2), (2, 0))])
    back = np.concatenate([key[:, b] * 31 + key[:, a] for a, b in ((0, 1), (1, 2), (2, 0))])
    assert np.array_equal(np.sort(forth), np.sort(back))


def test_build_seeds_vary_and_repeat_shape_and_albedo() -> None:
    first, again, other = (objects.build("bumps-textured", seed) for seed in (1, 1, 2))
    assert np.array_equal(first.mesh.triangles, again.mesh.triangles)
    assert not np.allclose(first.mesh.triangles, other.mesh.triangles, atol=1e-3)
    points = first.mesh.triangles[::50, 0]
    assert np.array_equal(first.texture(points), again.texture(points))
    assert not np.allclose(first.texture(points), other.texture(points), atol=0.05)


def test_build_finishes_set_albedo_and_gloss() -> None:
    soft, matt, textured, glossy = (objects.build(f"vase{end}", 3) for end in ("", "-matt", "-textured", "-glossy"))
    points = soft.mesh.triangles[:, 0]
    for scene in (soft, textured, glossy):
        albedo = scene.texture(points)
        assert albedo.min() >= 0.3 - 1e-6
        assert albedo.max() <= 0.7 + 1e-6
        assert np.ptp(albedo) > 0.15
    assert np.ptp(matt.texture(points)) == 0
    assert 0.55 <= matt.texture(points)[0] <= 0.65
    assert np.std(textured.texture(points)) > np.std(soft.texture(points))
    assert (soft.gloss, matt.gloss, textured.gloss) == (0, 0, 0)
    assert 0.1 <= glossy.gloss <= 0.2
    assert np.array_equal(soft.mesh.triangles, glossy.mesh.triangles)
    contrast = objects.build("vase-contrast", 3)
    dark, bright = np.quantile(contrast.texture(points), [0.05, 0.95])
    assert dark == pytest.approx(0.03, abs=0.01)
    assert bright == pytest.approx(0.9, abs=0.01)
    assert (contrast.gloss, contrast.gloss_exponent) == (glossy.gloss, objects.POLISHED)


@pytest.mark.parametrize("name", ["", "cube", "sphere-", "sphere-soft", "sphere-shiny", "SPHERE", "-matt"])
def test_build_unknown_name_raises(name: str) -> None:
    with pytest.raises(RigError, match="sphere") as caught:
        objects.build(name, 1)
    assert caught.value.code == ErrorCode.REQUEST_INVALID


def test_names_all_have_a_shape() -> None:
    assert len(objects.names()) == 30
    assert {name.split("-")[0] for name in objects.names()} == set(objects.SHAPES)
