"""The rendered reflectances against their formulas, written out here for one pixel at a time."""

import numpy as np
import pytest

from hardware_sim import indirect, render, sheets
from hardware_sim.objects import SceneObject, Texture
from hardware_sim.reflectance import Reflectance
from hardware_sim.render import Lamp, Lens
from hardware_sim.tracing import Tracer

ALBEDO = 0.6
HEIGHT = 0.01
PIXELS = 64
LAMP = np.array([0.21, -0.13, 0.30])
EVEN = Texture(ALBEDO, 0.0, 1.0, np.zeros((1, 3)), np.zeros(1))


def lens(pixels: int = PIXELS) -> Lens:
    """A camera that looks aslant, so that no angle is special."""
    eye, forward = np.array([-0.3, 0.25, 0.8]), -np.array([-0.3, 0.25, 0.79])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    matrix = np.array([[8.0 * pixels, 0, pixels / 2 - 0.5], [0, 8.0 * pixels, pixels / 2 - 0.5], [0, 0, 1]])
    return Lens(pixels, pixels, matrix, np.zeros(5), pose)


def plate(reflectance: Reflectance) -> SceneObject:
    mesh = sheets.box((-0.08, -0.08, 0.0), (0.08, 0.08, HEIGHT))
    return SceneObject("plate", mesh, EVEN, 0.0, 30.0, reflectance)


def lamp() -> Lamp:
    return Lamp(LAMP, -LAMP / np.linalg.norm(LAMP), 1.7, 0.45, 0.8)


def photograph(scene: SceneObject, light: Lamp, camera: Lens, subdivision: int = 2) -> np.ndarray:
    tracer = Tracer(scene.mesh)
    return render.direct_image(render.trace_view(scene, tracer, camera, subdivision), scene, tracer, light)


def seen_at(camera: Lens, row: int, column: int) -> tuple[float, float, float, float]:
    """Angles of incidence and exitance, difference of azimuths, and arriving light at the plate's point, rad."""
    ray = camera.directions(np.array([float(column)]), np.array([float(row)]))[0].astype(float)
    point = camera.eye + ray * (HEIGHT - camera.eye[2]) / ray[2]
    to_lamp, to_eye = LAMP - point, camera.eye - point
    distance = np.linalg.norm(to_lamp)
    incidence, exitance = np.arccos(to_lamp[2] / distance), np.arccos(to_eye[2] / np.linalg.norm(to_eye))
    between = np.arctan2(to_lamp[1], to_lamp[0]) - np.arctan2(to_eye[1], to_eye[0])
    arriving = 1.7 * (to_lamp @ LAMP / np.linalg.norm(LAMP) / distance) ** 0.8 * (0.45 / distance) ** 2
    return float(incidence), float(exitance), float(between), float(arriving)


def oren_nayar(incidence: float, exitance: float, between: float, sigma: float) -> float:
    """ρ cos θᵢ (A + B max(0, cos Δφ) sin α tan β): Oren and Nayar 1994, equation 30."""
    a = 1 - 0.5 * sigma**2 / (sigma**2 + 0.33)
    b = 0.45 * sigma**2 / (sigma**2 + 0.09)
    alpha, beta = max(incidence, exitance), min(incidence, exitance)
    return ALBEDO * np.cos(incidence) * (a + b * max(0.0, np.cos(between)) * np.sin(alpha) * np.tan(beta))


def ggx(incidence: float, exitance: float, between: float, alpha: float, f0: float) -> tuple[float, float]:
    """π D G F / (4 cos θᵢ cos θₒ) · cos θᵢ, Walter et al. 2007, with Schlick's F; and the angle of l to h."""
    light = np.array([np.sin(incidence), 0.0, np.cos(incidence)])
    eye = np.array([np.sin(exitance) * np.cos(between), np.sin(exitance) * np.sin(between), np.cos(exitance)])
    half = (light + eye) / np.linalg.norm(light + eye)
    tilt, turn = np.arccos(half[2]), float(light @ half)
    d = alpha**2 / (np.pi * np.cos(tilt) ** 4 * (alpha**2 + np.tan(tilt) ** 2) ** 2)
    g = 1.0
    for angle in (incidence, exitance):
        g *= 2 / (1 + np.sqrt(1 + alpha**2 * np.tan(angle) ** 2))
    fresnel = f0 + (1 - f0) * (1 - turn) ** 5
    return float(np.pi * d * g * fresnel / (4 * np.cos(exitance))), turn


@pytest.mark.parametrize(("row", "column"), [(31, 31), (10, 20), (55, 44)])
@pytest.mark.parametrize("text", ["oren-nayar:0.35", "ggx:0.2", "ggx:0.5", "metal:0.3"])
def test_direct_image_pixel_follows_formula(text: str, row: int, column: int) -> None:
    camera, reflectance = lens(), Reflectance.parse(text)
    incidence, exitance, between, arriving = seen_at(camera, row, column)
    if reflectance.kind == "oren-nayar":
        expected = oren_nayar(incidence, exitance, between, reflectance.roughness)
    elif reflectance.kind == "metal":
        expected = ALBEDO * ggx(incidence, exitance, between, reflectance.roughness, 0.9)[0]
    else:
        losses = [1 - (0.04 + 0.96 * (1 - np.cos(angle)) ** 5) for angle in (incidence, exitance)]
        diffuse = ALBEDO * np.cos(incidence) * losses[0] * losses[1]
        expected = diffuse + ggx(incidence, exitance, between, reflectance.roughness, 0.04)[0]
    image = photograph(plate(reflectance), lamp(), camera)
    assert image[row, column] == pytest.approx(arriving * expected, rel=2e-3)  # the pixel's mean against its middle


def test_direct_image_oren_nayar_of_no_roughness_is_lambert() -> None:
    smooth, plain = (
        photograph(plate(kind), lamp(), lens()) for kind in (Reflectance("oren-nayar", 0.0), Reflectance())
    )
    assert smooth == pytest.approx(plain, rel=1e-4)


def test_direct_image_highlight_is_averaged_over_footprint() -> None:
    """A pixel of a coarse image is the mean of the pixels of a fine one that it covers."""
    grids = [sheets.sheet(0.03 * unit + [0, 0, 0.03], unit) for unit in sheets.cube_directions(128)]
    scene = SceneObject("ball", sheets.joined(grids), EVEN, 0.0, 30.0, Reflectance("metal", 0.1))
    coarse, fine = photograph(scene, lamp(), lens(32), 4), photograph(scene, lamp(), lens(128), 1)
    assert coarse == pytest.approx(fine.reshape(32, 4, 32, 4).mean(axis=(1, 3)), abs=2e-3 * float(coarse.max()))


def test_scattered_step_of_albedo_follows_integral() -> None:
    """Where d from a straight step, the light from beyond it is the mean of exp(-d / (l cos a)) over directions a."""
    mean_m, pixels = 0.003, 200
    camera = Lens(
        pixels, pixels, np.array([[1000.0, 0, 99.5], [0, 1000.0, 99.5], [0, 0, 1]]), np.zeros(5),
        np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 0.51], [0, 0, 0, 1]]),
    )  # fmt: skip
    halves = Texture(0.5, 0.2, 1e6, np.array([[2.0, 0.0, 0.0]]), np.array([np.pi / 2]))  # 0.7 left, 0.3 right of x = 0
    step = SceneObject("step", plate(Reflectance()).mesh, halves, 0.0, 30.0, Reflectance(scatter_m=mean_m))
    irradiance = photograph(plate(Reflectance()), lamp(), camera) / ALBEDO
    albedo = photograph(step, lamp(), camera) / irradiance
    directions = (np.arange(4000) + 0.5) / 4000 * np.pi - np.pi / 2
    for column in (100, 103, 106, 112, 120):
        away = (column - 99.5) * 0.5 / 1000
        crossed = np.exp(-away / (mean_m * np.cos(directions))).mean() / 2
        assert albedo[90:110, column] == pytest.approx(0.3 + 0.4 * crossed, abs=0.004)
        assert albedo[90:110, 199 - column] == pytest.approx(0.7 - 0.4 * crossed, abs=0.004)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("lambert", 1, 1),
        ("oren-nayar:0.3", 0.9, 1),
        ("oren-nayar:0.8", 0.75, 1),
        ("ggx:0.2", 0.75, 0.9),
        ("metal:0.3", 0, 0),
    ],
)
def test_diffuse_share_of_each_kind(text: str, low: float, high: float) -> None:
    reflectance = Reflectance.parse(text)
    share = indirect.diffuse_share(reflectance)
    assert low <= share <= high
    if reflectance.kind == "ggx":
        # Both directions independent: the mean of 1 - F over the cosine, squared; Schlick's mean is f0 + (1 - f0) / 21.
        assert share == pytest.approx((1 - 0.04 - 0.96 / 21) ** 2, rel=2e-3)
