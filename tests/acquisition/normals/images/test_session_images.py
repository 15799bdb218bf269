"""Frames to values: the calibrated flat field is taken out, in every window of the frame alike."""

import numpy as np
import pytest

from acquisition import image_values
from acquisition.models.calibration import FlatField
from acquisition.normals.images import session_images
from tests.acquisition import scenes

SIZE = 48
FLAT = FlatField(terms=(0.03, -0.02, -0.1, 0.01, -0.08), covariance=((1e-6, 0.0, 0.0, 0.0, 0.0),) * 5)


def test_read_divides_by_calibrated_flat_field() -> None:
    even = scenes.calibration(SIZE)
    flat = even.model_copy(update={"flat_field": FLAT})
    shown = scenes.capture(scenes.scene(scenes.bumps, even), scenes.ring(4, 30.0), seed=1)
    rows, columns = slice(5, 41), slice(8, 40)
    taken = [session_images.read(shown, one, rows, columns).read(3, 20)[0] for one in (even, flat)]
    v, u = np.mgrid[8:25, 8:40]
    half = np.hypot(SIZE, SIZE) / 2
    u, v = (u - (SIZE - 1) / 2) / half, (v - (SIZE - 1) / 2) / half
    passed = np.exp(0.03 * u - 0.02 * v - 0.1 * u * u + 0.01 * u * v - 0.08 * v * v)
    np.testing.assert_allclose(taken[1] * passed, taken[0], rtol=1e-5)


def test_sensitivity_is_one_in_centre_and_none_where_unknown() -> None:
    even = scenes.calibration(49)
    assert image_values.sensitivity(even, slice(0, 49), slice(0, 49)) is None
    known = image_values.sensitivity(even.model_copy(update={"flat_field": FLAT}), slice(24, 25), slice(24, 25))
    assert known == pytest.approx(1.0)
