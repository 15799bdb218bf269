"""Colour spaces and CIEDE2000 against published values."""

import numpy as np
import pytest

from acquisition import colour

SHARMA = """
50 2.6772 -79.7751 50 0 -82.7485 2.0425
50 3.1571 -77.2803 50 0 -82.7485 2.8615
50 2.8361 -74.0200 50 0 -82.7485 3.4412
50 -1.3802 -84.2814 50 0 -82.7485 1.0000
50 -1.1848 -84.8006 50 0 -82.7485 1.0000
50 -0.9009 -85.5211 50 0 -82.7485 1.0000
50 0 0 50 -1 2 2.3669
50 -1 2 50 0 0 2.3669
50 2.4900 -0.0010 50 -2.4900 0.0009 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0010 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0011 7.2195
50 2.4900 -0.0010 50 -2.4900 0.0012 7.2195
50 -0.0010 2.4900 50 0.0009 -2.4900 4.8045
50 -0.0010 2.4900 50 0.0010 -2.4900 4.8045
50 -0.0010 2.4900 50 0.0011 -2.4900 4.7461
50 2.5 0 50 0 -2.5 4.3065
50 2.5 0 73 25 -18 27.1492
50 2.5 0 61 -5 29 22.8977
50 2.5 0 56 -27 -3 31.9030
50 2.5 0 58 24 15 19.4535
50 2.5 0 50 3.1736 0.5854 1.0000
50 2.5 0 50 3.2972 0 1.0000
50 2.5 0 50 1.8634 0.5757 1.0000
50 2.5 0 50 3.2592 0.3350 1.0000
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381
6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
"""
"""The 34 pairs of Sharma, Wu and Dalal (Color Research and Application 30, 2005, table 1)."""


def test_delta_e_2000_of_published_pairs_is_as_published() -> None:
    pairs = np.array([line.split() for line in SHARMA.strip().splitlines()], dtype=float)
    assert len(pairs) == 34
    found = colour.delta_e_2000(pairs[:, :3], pairs[:, 3:6])
    np.testing.assert_allclose(found, pairs[:, 6], atol=6e-5)  # four decimals are printed
    np.testing.assert_allclose(colour.delta_e_2000(pairs[:, 3:6], pairs[:, :3]), found, atol=1e-9)


def test_lab_from_srgb_of_white_and_primaries_is_as_published() -> None:
    lab = colour.lab_from_srgb(np.concatenate([np.ones((1, 3)), np.eye(3)]))
    known = [[100, 0, 0], [54.29, 80.81, 69.89], [87.82, -79.27, 80.99], [29.57, 68.30, -112.03]]
    np.testing.assert_allclose(lab, known, atol=0.03)  # sRGB in D50 of the ICC's profile, two decimals


def test_srgb_from_lab_inverts_lab_from_srgb() -> None:
    linear = np.random.default_rng(0).uniform(0, 1, (200, 3))
    np.testing.assert_allclose(colour.srgb_from_lab(colour.lab_from_srgb(linear)), linear, atol=1e-9)


@pytest.mark.parametrize(("linear", "encoded"), [(0.0, 0.0), (0.0021, 0.0271), (0.214041, 0.5), (1.0, 1.0), (2.0, 1.0)])
def test_encoded_srgb_follows_the_standard_curve(linear: float, encoded: float) -> None:
    assert colour.encoded_srgb(np.array(linear)) == pytest.approx(encoded, abs=1e-4)
