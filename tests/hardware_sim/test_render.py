"""The rendered image against closed forms: every expected number here is computed without the renderer."""

from functools import cache

import cv2
import numpy as np
import pytest

from acquisition import geometry
from hardware_sim import objects, render, sheets
from hardware_sim.objects import SceneObject, Texture
from hardware_sim.render import Lamp, Lens, View
from hardware_sim.tracing import Tracer

WHITE = Texture(1.0, 0.0, 1.0, np.zeros((1, 3)), np.zeros(1))
REFERENCE = 0.45


def lens(pixels: int = 128, distortion: tuple[float, ...] = (0.0,) * 5) -> Lens:
    focal = 4600.0 * pixels / 1024
    matrix = np.array([[focal, 0, pixels / 2 - 0.5], [0, focal, pixels / 2 - 0.5], [0, 0, 1]])
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[2, 3] = 0.9
    return Lens(pixels, pixels, matrix, np.array(distortion), down)


def plate() -> SceneObject:
    """A white square of 0.16 m whose top is at 10 mm: it fills the middle of the picture."""
    return SceneObject("plate", sheets.box((-0.08, -0.08, 0.0), (0.08, 0.08, 0.01)), WHITE, 0.0, 30.0)


@cache
def ball_mesh() -> sheets.Mesh:
    radius = 0.04
    return sheets.joined([sheets.sheet(radius * unit + [0, 0, radius], unit) for unit in sheets.cube_directions(128)])


@cache
def ball_tracer() -> Tracer:
    return Tracer(ball_mesh())


def ball(gloss: float = 0.0) -> SceneObject:
    return SceneObject("ball", ball_mesh(), WHITE, gloss, 30.0)


def lamp_at(position: np.ndarray, target: tuple[float, float, float], power: float = 1.0, lobe: float = 0.8) -> Lamp:
    axis = np.array(target) - position
    return Lamp(np.array(position), axis / np.linalg.norm(axis), power, REFERENCE, lobe)


def photograph(scene: SceneObject, lamp: Lamp, camera: Lens, subdivision: int = 2) -> np.ndarray:
    tracer = Tracer(scene.mesh)
    return render.direct_image(render.trace_view(scene, tracer, camera, subdivision), scene, tracer, lamp)


def plane_point(camera: Lens, row: int, column: int, height: float) -> np.ndarray:
    direction = camera.directions(np.array([float(column)]), np.array([float(row)]))[0].astype(float)
    return camera.eye + direction * (height - camera.eye[2]) / direction[2]


def test_direct_image_white_surface_at_reference_is_one() -> None:
    camera = lens()
    image = photograph(plate(), lamp_at(np.array([0, 0, 0.01 + REFERENCE]), (0, 0, 0), power=0.7), camera)
    assert image[63:65, 63:65] == pytest.approx(0.7, rel=1e-4)


def test_direct_image_falls_with_distance_slant_and_lobe() -> None:
    camera = lens()
    position = np.array([0.21, -0.13, 0.38])
    image = photograph(plate(), lamp_at(position, (0.05, 0.02, 0.01), power=2.0, lobe=1.7), camera)
    axis = np.array([0.05, 0.02, 0.01]) - position
    axis /= np.linalg.norm(axis)
    for row, column in ((64, 64), (20, 30), (100, 90), (40, 110)):
        to_lamp = position - plane_point(camera, row, column, 0.01)
        distance = np.linalg.norm(to_lamp)
        expected = 2.0 * (to_lamp[2] / distance) * (-(to_lamp @ axis) / distance) ** 1.7 * (REFERENCE / distance) ** 2
        assert image[row, column] == pytest.approx(expected, rel=2e-4)


def test_direct_image_lamp_facing_away_is_dark() -> None:
    assert photograph(plate(), lamp_at(np.array([0, 0, 0.4]), (0, 0, 0.8)), lens()).max() == 0


def test_lit_mask_attached_shadow_begins_at_terminator() -> None:
    camera, scene = lens(256), ball()
    position = np.array([0.35, 0.1, 0.25])
    samples = render.object_samples(scene, ball_tracer(), camera.eye, _centres(camera))
    free = render.lit_mask(samples.points, samples.normals, position, ball_tracer(), scene)
    exact = (samples.points - [0, 0, 0.04]) / 0.04
    cosine = np.einsum("ni,ni->n", exact, position - samples.points) / np.linalg.norm(position - samples.points, axis=1)
    assert free[cosine > 0.02].all()
    assert not free[cosine < -0.005].any()


def test_lit_mask_sphere_casts_shadow_on_table() -> None:
    camera, scene = lens(256), ball()
    position = np.array([0.30, 0.0, 0.33])
    tracer = ball_tracer()
    view = render.trace_view(scene, tracer, camera, 2)
    free = render.lit_mask(view.table.points, view.table.normals, position, tracer, scene)
    # The way from a point to the lamp passes the sphere's centre at this distance.
    displacement = position - view.table.points
    displacement /= np.linalg.norm(displacement, axis=1, keepdims=True)
    to_centre = np.array([0, 0, 0.04]) - view.table.points
    passing = np.linalg.norm(to_centre - np.einsum("ni,ni->n", to_centre, displacement)[:, None] * displacement, axis=1)
    assert free[passing > 0.0401].all()
    assert not free[passing < 0.0399].any()
    assert (passing < 0.0399).sum() > 5000


def test_direct_image_shadow_edge_has_half_lit_pixels() -> None:
    camera, scene = lens(256), ball()
    tracer = ball_tracer()
    view = render.trace_view(scene, tracer, camera, 2)
    lamp = lamp_at(np.array([0.30, 0.0, 0.33]), (0, 0, 0.03))
    image = render.direct_image(view, scene, tracer, lamp)
    table = np.ones(256 * 256, bool)
    table[view.surface.pixels] = False
    rays = _centres(camera).astype(float)
    points = camera.eye + rays * (-camera.eye[2] / rays[:, 2])[:, None]
    unshadowed = render.TABLE_ALBEDO * lamp.irradiance(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
    lit_share = image.ravel()[table] / unshadowed[table]
    assert ((lit_share < 0.01) | (lit_share > 0.15)).all()  # four samples: nothing, a quarter, a half …
    half = (lit_share > 0.15) & (lit_share < 0.9)
    assert 100 < half.sum() < 1500


def test_object_samples_sphere_normals_are_exact() -> None:
    camera, scene = lens(256), ball()
    samples = render.object_samples(scene, ball_tracer(), camera.eye, _centres(camera))
    # Where a ray meets a sphere, without any mesh.
    rays = _centres(camera)[samples.pixels].astype(float)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    from_centre = camera.eye - [0, 0, 0.04]
    along = rays @ from_centre
    under_root = along**2 - (from_centre @ from_centre - 0.04**2)
    exact = (from_centre + (-along - np.sqrt(np.maximum(under_root, 0)))[:, None] * rays) / 0.04
    inside = under_root > 1e-6
    error = np.degrees(
        np.arctan2(np.linalg.norm(np.cross(samples.normals, exact), axis=1), (samples.normals * exact).sum(1))
    )
    assert np.median(error[inside]) < 0.01
    assert np.percentile(error[inside], 99) < 0.2


def test_directions_pass_through_distorted_pixels() -> None:
    camera = lens(1024, (-0.08, 0.05, 0.0004, -0.0003, 0.0))
    pixels = np.array([[0.0, 0.0], [1023.0, 5.25], [511.5, 511.5], [200.0, 900.75]])
    directions = camera.directions(pixels[:, 0], pixels[:, 1])
    in_camera = geometry.rotate(geometry.inverse(camera.object_from_camera), directions)
    back, _ = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert back.reshape(-1, 2) == pytest.approx(pixels, abs=1e-3)


def test_direct_image_gloss_peaks_at_half_vector() -> None:
    camera = lens(256)
    lamp = lamp_at(np.array([0.25, 0.1, 0.4]), (0, 0, 0.04))
    shine = photograph(ball(0.2), lamp, camera) - photograph(ball(), lamp, camera)
    row, column = np.unravel_index(int(shine.argmax()), shine.shape)
    scene = ball()
    samples = render.object_samples(scene, ball_tracer(), camera.eye, _centres(camera))
    sample = int(np.nonzero(samples.pixels == row * 256 + column)[0][0])
    to_lamp, to_eye = lamp.position - samples.points[sample], camera.eye - samples.points[sample]
    half = to_lamp / np.linalg.norm(to_lamp) + to_eye / np.linalg.norm(to_eye)
    assert samples.normals[sample] @ half / np.linalg.norm(half) > np.cos(np.radians(1.5))
    distance = np.linalg.norm(to_lamp)
    arriving = (REFERENCE / distance) ** 2 * (-(to_lamp @ lamp.axis) / distance) ** 0.8
    assert shine.max() == pytest.approx(0.2 * arriving, rel=0.01)


def test_trace_view_finer_sampling_changes_little() -> None:
    camera, scene = lens(128), objects.build("bumps", 1)
    lamp = lamp_at(np.array([0.25, 0.1, 0.35]), (0, 0, 0.03))
    coarse, fine = (photograph(scene, lamp, camera, n) for n in (2, 6))
    assert np.abs(coarse - fine).mean() < 0.002 * fine.mean() + 1e-3
    assert coarse.mean() == pytest.approx(fine.mean(), rel=2e-3)


def test_trace_view_shares_fill_every_pixel() -> None:
    scene = objects.build("vase", 1)
    view: View = render.trace_view(scene, Tracer(scene.mesh), lens(96), 3)
    filled = sum(np.bincount(s.pixels, minlength=96 * 96) for s in (view.surface, view.table))
    assert np.all(filled == 9)


def _centres(camera: Lens) -> np.ndarray:
    rows, columns = np.divmod(np.arange(camera.width * camera.height, dtype=float), camera.width)
    return camera.directions(columns, rows)
