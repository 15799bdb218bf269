"""Photon transfer on synthetic differences of known gain and read noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import photometry
from acquisition.normals.uncertainty import photon_transfer
from acquisition.normals.uncertainty.photon_transfer import TransferCurve

TOP = 4000.0


def curve(gain: float, read_dn: float, count: int = 30_000, pattern: float = 0.0, seed: int = 0) -> TransferCurve:
    """Of four neighbours each, spread over all brightness, and as many in the dark; `pattern` is a share of it."""
    rng = np.random.default_rng(seed)
    level = np.concatenate([rng.uniform(0, TOP, count), np.zeros(count)]).astype(np.float32)
    scattered = rng.normal(size=(4, 2 * count)) * np.sqrt(level / gain + read_dn**2 + (pattern * level) ** 2)
    return photon_transfer.transfer_curve(level, np.sum(np.rint(scattered), axis=0, dtype=np.float32) / 2, TOP, 1.0)


@settings(max_examples=12, deadline=None)
@given(
    gain=st.floats(0.1, 10.0),
    read_dn=st.floats(0.8, 20.0),
    pattern=st.floats(0.0, 0.0015),
    seed=st.integers(0, 2**32),
)
def test_fit_line_synthetic_sensor_recovers_gain_and_read_noise(
    gain: float, read_dn: float, pattern: float, seed: int
) -> None:
    line = photon_transfer.fit_line(curve(gain, read_dn, pattern=pattern, seed=seed))
    assert line is not None
    assert abs(line.slope - 1 / gain) < 5 * line.slope_sigma
    assert abs(line.floor - (read_dn**2 + 1 / 12)) < 5 * line.floor_sigma
    assert line.floor_sigma < 0.1 * line.floor


def test_fit_line_more_pixels_lowers_sigma() -> None:
    few, many = (photon_transfer.fit_line(curve(1.0, 2.0, count)) for count in (3_000, 100_000))
    assert few is not None
    assert many is not None
    assert many.slope_sigma < 0.5 * few.slope_sigma
    assert many.slope == pytest.approx(1.0, rel=0.02)


def test_transfer_curve_few_per_cent_outliers_are_clipped() -> None:
    rng = np.random.default_rng(1)
    level = np.full(20_000, 1000.0, np.float32)
    scattered = rng.normal(size=level.shape) * 30
    edges = np.where(rng.random(level.shape) < 0.04, 20 * scattered, scattered).astype(np.float32)
    (variance,) = photon_transfer.transfer_curve(level, edges, TOP, 1.0).variance
    assert variance == pytest.approx(900, rel=0.06)
    assert np.var(edges) > 10_000


def test_transfer_curve_scatter_below_rounding_drops_bin() -> None:
    rng = np.random.default_rng(2)
    level = rng.uniform(0, TOP, 50_000).astype(np.float32)
    scattered = rng.normal(size=(4, *level.shape))
    for sigma, kept in ((0.2, False), (0.45, False), (0.6, True), (2.0, True)):
        difference = np.sum(np.rint(sigma * scattered), axis=0, dtype=np.float32) / 2
        points = len(photon_transfer.transfer_curve(level, difference, TOP, 1.0).level)
        assert points > 10 if kept else points == 0, sigma


def test_fit_line_two_points_returns_none() -> None:
    both = np.array([1.0, 2.0])
    assert photon_transfer.fit_line(TransferCurve(both, both, 0.01 * both)) is None


def test_transfer_curve_few_pixels_drops_bin() -> None:
    level = np.repeat(np.float32([10.0, 3000.0]), [photometry.SETTINGS.min_sample - 1, photometry.SETTINGS.min_sample])
    scattered = np.random.default_rng(3).normal(size=level.shape).astype(np.float32) * 10
    assert photon_transfer.transfer_curve(level, scattered, TOP, 1.0).level.tolist() == [3000.0]
