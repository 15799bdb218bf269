"""Interreflections and ambient light against a path tracer written here, which has no patches."""

import numpy as np
import pytest

from acquisition import geometry
from hardware_sim import nominal, objects, render
from hardware_sim.indirect import IndirectLight
from hardware_sim.objects import SceneObject
from hardware_sim.render import TABLE_ALBEDO, Lamp, Lens, Samples
from hardware_sim.tracing import START_M, Tracer

PIXELS = 128


def lens(pixels: int = PIXELS, beside_m: float = 0.0) -> Lens:
    """A camera above the object, or beside it."""
    calibration = nominal.calibration(pixels)
    object_from_camera = np.array(calibration.base_from_camera)
    object_from_camera[0, 3] += beside_m - 0.55
    matrix, distortion = np.array(calibration.camera_matrix), np.array(calibration.distortion)
    return Lens(pixels, pixels, matrix, distortion, object_from_camera)


def lamp() -> Lamp:
    towards = geometry.direction(np.radians(45), 1.0)
    return Lamp(np.array([0, 0, 0.03]) + 0.45 * towards, -towards, 1.0, 0.45, 0.8)


def trace_paths(
    scene: SceneObject, tracer: Tracer, start: Samples, paths: int, light: Lamp | None, bounces: int = 5
) -> np.ndarray:
    """Indirect light of a lamp, or all light of a sky of brightness 1, at each start point, by random paths."""
    random = np.random.default_rng(2)
    points = np.repeat(start.points.astype(float), paths, axis=0)
    normals = np.repeat(start.normals.astype(float), paths, axis=0)
    carried = np.ones(len(points))
    gathered = np.zeros(len(points))
    mesh = scene.mesh
    for _ in range(bounces):
        # Cosine-weighted directions: a point of the unit sphere about the tip of the normal.
        directions = random.normal(size=points.shape)
        directions = normals + directions / np.linalg.norm(directions, axis=1, keepdims=True)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        origins = (points + START_M * normals).astype(np.float32)
        hits = tracer.first_hits(origins, directions.astype(np.float32))
        on_object = hits.triangles >= 0
        on_table = ~on_object & (directions[:, 2] < -1e-9)
        gone = ~on_object & ~on_table
        if light is None:
            gathered[gone] += carried[gone]
        reach = np.where(on_object, hits.distances, -origins[:, 2] / np.where(on_table, directions[:, 2], -1.0))
        points = origins + directions * reach[:, None]
        normals = np.where(on_object[:, None], mesh.face_normals[hits.triangles], [0.0, 0.0, 1.0])
        # A face met from behind is the inside of a shading normal's slip; nothing comes from there.
        behind = on_object & (np.einsum("ni,ni->n", normals, directions) > 0)
        albedo = np.where(on_object, scene.texture(points), TABLE_ALBEDO)
        carried = np.where(gone | behind, 0.0, carried * albedo)
        if light is not None:
            free = render.lit_mask(points.astype(np.float32), normals.astype(np.float32), light.position, tracer, scene)
            gathered += np.where(carried > 0, carried * light.irradiance(points, normals) * free, 0.0)
    return gathered.reshape(-1, paths).mean(axis=1)


@pytest.fixture(scope="module", params=["part"])
def made(request: pytest.FixtureRequest) -> tuple[SceneObject, Tracer, IndirectLight, Samples]:
    scene = objects.build(request.param, 1)
    tracer = Tracer(scene.mesh)
    camera = lens()
    view = render.trace_view(scene, tracer, camera, 1)
    facing = np.nonzero(view.surface.normals[:, 2] > 0.3)[0]
    some = np.random.default_rng(1).choice(facing, 1000, replace=False)
    surface = view.surface
    points = Samples(surface.pixels[some], surface.points[some], surface.normals[some], surface.albedo[some])
    return scene, tracer, IndirectLight(scene, tracer, view), points


def test_interreflections_agree_with_path_tracing(
    made: tuple[SceneObject, Tracer, IndirectLight, Samples],
) -> None:
    scene, tracer, indirect, points = made
    expected = trace_paths(scene, tracer, points, 200, lamp())
    result = indirect.interreflections(lamp()).ravel()[points.pixels] / points.albedo
    assert result.sum() == pytest.approx(expected.sum(), rel=0.03)
    assert np.corrcoef(result, expected)[0, 1] > 0.97
    assert np.sqrt(np.mean((result - expected) ** 2)) < 0.22 * np.sqrt(np.mean(expected**2))


def test_ambient_agrees_with_path_tracing(
    made: tuple[SceneObject, Tracer, IndirectLight, Samples],
) -> None:
    scene, tracer, indirect, points = made
    expected = trace_paths(scene, tracer, points, 200, None)
    result = indirect.ambient().ravel()[points.pixels] / points.albedo
    assert result.mean() == pytest.approx(expected.mean(), rel=0.02)
    assert np.corrcoef(result, expected)[0, 1] > 0.97


@pytest.mark.parametrize(("pixels", "beside_m", "seen"), [(6, 0.0, 9), (2, 0.0, 1), (PIXELS, 2.0, 0)])
def test_interreflections_of_an_object_of_few_pixels_or_none(pixels: int, beside_m: float, seen: int) -> None:
    scene = objects.build("part", 1)
    tracer = Tracer(scene.mesh)
    view = render.trace_view(scene, tracer, lens(pixels, beside_m), 1)
    image = IndirectLight(scene, tracer, view).interreflections(lamp()).ravel()
    assert len(view.surface.pixels) == seen
    expected = trace_paths(scene, tracer, view.surface, 2000, lamp()) * view.surface.albedo
    assert image[view.surface.pixels] == pytest.approx(expected, rel=0.2, abs=0.002)
