"""Three channels as measurements of one normal: against the joint fit of normal and three albedos."""

import numpy as np
from scipy.optimize import least_squares

from acquisition.normals.images import colour_channels

ALBEDO = np.array([0.8, 0.3, 0.1])
PIXELS = 60
WELL_E = 4000.0
WHITE = np.ones((8, 3))


def _measured(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lights (F, 3), photon counts over the full well (F, PIXELS, 3), and the true normals (PIXELS, 3)."""
    random = np.random.default_rng(seed)
    lights = random.normal(size=(8, 3)) * (0.5, 0.5, 0) + (0, 0, 1)
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    normals = random.normal(size=(PIXELS, 3)) * 0.15 + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    values = (lights @ normals.T)[..., None] * ALBEDO
    return lights, random.poisson(values * WELL_E) / WELL_E, normals


def _joint(lights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Normal by weighted least squares over normal and three albedos of one pixel (F, 3), all at once."""
    sigma = np.sqrt(np.maximum(values, 1e-3) / WELL_E)

    def residuals(state: np.ndarray) -> np.ndarray:
        g = np.array([state[0], state[1], 1.0])
        predicted = np.multiply.outer(lights @ g / np.linalg.norm(g), state[2:])
        return ((predicted - values) / sigma).ravel()

    x = least_squares(residuals, [0.0, 0.0, *values.mean(axis=0)]).x
    g = np.array([x[0], x[1], 1.0])
    return g / np.linalg.norm(g)


def _of_one_value(lights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Normal by weighted least squares from one value an image (F,)."""
    weight = 1 / np.maximum(values, 1e-3)
    g = np.linalg.solve((lights.T * weight) @ lights, lights.T @ (weight * values))
    return g / np.linalg.norm(g)


def test_combined_channels_lose_nothing_against_the_joint_fit() -> None:
    lights, values, normals = _measured(1)
    one, clipped = colour_channels.combined(values.astype(np.float32), np.zeros(values.shape, bool), WHITE)
    assert not clipped.any()
    joint = np.array([_joint(lights, values[:, pixel]) for pixel in range(PIXELS)])
    ours = np.array([_of_one_value(lights, one[:, pixel].astype(float)) for pixel in range(PIXELS)])
    error, other = (np.linalg.norm(found - normals, axis=1) for found in (ours, joint))
    # Estimates of one likelihood: they differ by second order in the noise, far below their errors.
    assert np.median(np.linalg.norm(ours - joint, axis=1)) < 0.3 * np.median(other)
    assert np.sqrt(np.mean(error**2)) < 1.05 * np.sqrt(np.mean(other**2))


def test_combined_without_a_clipped_channel_is_unbiased() -> None:
    _, values, _ = _measured(2)
    clipped = np.zeros(values.shape, bool)
    clipped[0, :, 0] = True  # red, which has two thirds of the light
    wrong = values.copy()
    wrong[0, :, 0] = 0.5 * values[0, :, 0]
    found, gone = colour_channels.combined(wrong.astype(np.float32), clipped, WHITE)
    assert not gone.any()
    expected = values.mean(axis=-1)
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-5)
    ratio = found[0] / expected[0]
    # Green and blue hold a third of the photons of some 4000 · 0.4: 2–3 % each, 0.4 % over 60 pixels.
    assert abs(float(ratio.mean()) - 1) < 0.02


def test_combined_of_wholly_clipped_measurements_says_so() -> None:
    _, values, _ = _measured(3)
    clipped = np.zeros(values.shape, bool)
    clipped[2] = True
    clipped[3, :, :2] = True  # blue alone is left, a twelfth of the light
    _, gone = colour_channels.combined(values.astype(np.float32), clipped, WHITE)
    assert gone[2:4].all()
    assert not np.delete(gone, [2, 3], axis=0).any()


def test_ratios_are_those_of_the_albedos() -> None:
    _, values, _ = _measured(4)
    found = colour_channels.ratios(values.astype(np.float32), np.ones(values.shape[:2], bool), WHITE)
    np.testing.assert_allclose(found.mean(axis=0), ALBEDO / ALBEDO.mean(), rtol=0.02)
    none = colour_channels.ratios(values.astype(np.float32), np.zeros(values.shape[:2], bool), WHITE)
    np.testing.assert_array_equal(none, 1)


def test_combined_and_ratios_under_coloured_light_are_those_of_white() -> None:
    _, values, _ = _measured(5)
    light = np.random.default_rng(5).uniform(0.2, 1.5, (8, 3))
    clipped = np.zeros(values.shape, bool)
    white, _ = colour_channels.combined(values.astype(np.float32), clipped, WHITE)
    lit = (values * light[:, None]).astype(np.float32)
    found, _ = colour_channels.combined(lit, clipped, light)
    # Weighted by other counts of photons, of which each value has some 1600.
    assert np.sqrt(np.mean((found / white - 1) ** 2)) < 0.02
    ratio = colour_channels.ratios(lit, ~clipped.any(axis=-1), light)
    np.testing.assert_allclose(
        ratio, colour_channels.ratios(values.astype(np.float32), ~clipped.any(axis=-1), WHITE), rtol=0.05
    )
