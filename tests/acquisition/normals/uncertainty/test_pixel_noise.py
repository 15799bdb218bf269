"""Noise estimated from neighbouring pixels of a textured cushion under lamps with position errors."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.models.light_plan import Light
from acquisition.normals.images.normalised_images import ImageBlock, Images
from acquisition.normals.uncertainty import pixel_noise
from tests.acquisition import scenes

SIZE, INTENSITY, GUESSED = 160, 0.8, 10_000
LIGHTS = [*scenes.ring(4, 30.0), *scenes.ring(4, 55.0, turn=0.4)]


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    true = scenes.scene(scenes.bumps, scenes.calibration(SIZE, lobe_exponent=0.0))
    dots = np.random.default_rng(9).random(true.albedo.shape) < 0.5
    return replace(true, albedo=true.albedo * np.where(dots, 1.0, 0.7))


@pytest.fixture(scope="module")
def light(cushion: scenes.Scene) -> np.ndarray:
    """Irradiance on the sensor (F, H, W), with unknown lamp errors of 1 mm and 1 %."""
    rng = np.random.default_rng(4)
    moved = [
        Light(position=tuple(np.array(one.position) + rng.normal(0, 1e-3, 3)), axis=one.axis)  # pyright: ignore[reportArgumentType]
        for one in LIGHTS
    ]
    return np.stack([scenes.lit(cushion, one) * (1 + rng.normal(0, 0.01)) for one in moved])


def simulated(light: np.ndarray, full_well: float, read_e: float, bits: int) -> tuple[Images, np.ndarray]:
    """Images of a sensor, with noise that is guessed, and the steps of their values (F,)."""
    rng = np.random.default_rng(1)
    electrons = rng.poisson(light * INTENSITY * full_well) + rng.normal(0, read_e, light.shape)
    top = 2**bits - 1
    values = (np.clip(np.round(electrons / full_well * top), 0, top) / top / INTENSITY).astype(np.float32)
    count, all_pixels = len(light), slice(0, SIZE)
    shot = np.full(count, 1 / (GUESSED * INTENSITY))
    floor = np.full(count, (5 / GUESSED / INTENSITY) ** 2)
    block = ImageBlock(values, values >= 1 / INTENSITY)
    stack = Images(block.rows, tuple(LIGHTS[:count]), all_pixels, all_pixels, shot, floor)
    return stack, np.full(count, 1 / top / INTENSITY)


def estimated(cushion: scenes.Scene, stack: Images, steps: np.ndarray, mask: np.ndarray) -> tuple[Images, str]:
    return pixel_noise.estimate(stack, mask, np.full(mask.shape, 0.87, np.float32), cushion.calibration, steps)


@pytest.mark.parametrize(("full_well", "read_e", "bits"), [(2000, 8, 12), (10_000, 5, 8), (40_000, 10, 16)])
def test_estimate_wrong_guess_recovers_noise(
    cushion: scenes.Scene, light: np.ndarray, full_well: float, read_e: float, bits: int
) -> None:
    images, note = estimated(cushion, *simulated(light, full_well, read_e, bits), cushion.mask)
    values = np.array([0.1, 0.2, 0.4])
    variance = images.shot[:, None] * values + images.floor[:, None]
    electrons2 = values * INTENSITY * full_well + read_e**2 + (full_well / (2**bits - 1)) ** 2 / 12
    np.testing.assert_allclose(variance, np.tile(electrons2 / (full_well * INTENSITY) ** 2, (8, 1)), rtol=0.2)
    assert note.startswith("noise estimated")


def test_estimate_too_few_pixels_keeps_guess_and_notes_it(cushion: scenes.Scene, light: np.ndarray) -> None:
    four, steps = simulated(light[:4], 2000, 8, 12)
    all_lights, all_steps = simulated(light, 2000, 8, 12)
    corner = np.zeros_like(cushion.mask)
    corner[70:76, 70:76] = True
    for stack, step, mask in ((four, steps, cushion.mask), (all_lights, all_steps, corner)):
        images, note = estimated(cushion, stack, step, mask)
        assert images is stack
        assert note.startswith("guessed: ")
