"""Colour spaces and colour difference: linear sRGB, CIELAB under D50, CIEDE2000.

Reference values of charts are in CIELAB under D50 (ISO 13655), albedos in linear sRGB (white D65). The Bradford
adaptation converts one to the other (ICC.1:2022, annex E).
"""

import numpy as np

from acquisition.models.base import FloatArray

D50_WHITE = np.array([0.9642, 1.0, 0.8249])
"""XYZ of the white of the ICC's profile connection space."""

XYZ_D50_FROM_SRGB = np.array(
    [[0.4360747, 0.3850649, 0.1430804], [0.2225045, 0.7168786, 0.0606169], [0.0139322, 0.0971045, 0.7141733]]
)
"""XYZ under D50 from linear sRGB: its primaries (IEC 61966-2-1) with Bradford's adaptation from D65."""

SRGB_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""x, y of red, green, blue and white (ITU-R BT.709)."""

_EPSILON, _KAPPA = (6 / 29) ** 3, (29 / 3) ** 3
_SEVENTH_POWER_OF_25 = 25.0**7


def lab_from_srgb(linear: FloatArray) -> FloatArray:
    """CIELAB under D50 (..., 3) of linear sRGB (..., 3)."""
    ratio = linear @ XYZ_D50_FROM_SRGB.T / D50_WHITE
    f = np.where(ratio > _EPSILON, np.cbrt(ratio), (_KAPPA * ratio + 16) / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def srgb_from_lab(lab: FloatArray) -> FloatArray:
    """Linear sRGB (..., 3) of CIELAB under D50 (..., 3); outside 0 to 1 for colours that sRGB does not have."""
    y = (lab[..., 0] + 16) / 116
    f = np.stack([y + lab[..., 1] / 500, y, y - lab[..., 2] / 200], axis=-1)
    ratio = np.where(f > 6 / 29, f**3, (116 * f - 16) / _KAPPA)
    return np.linalg.solve(XYZ_D50_FROM_SRGB, (ratio * D50_WHITE)[..., None])[..., 0]


def encoded_srgb(linear: FloatArray) -> FloatArray:
    """Non-linear sRGB 0–1 (...) of linear values (...), clipped (IEC 61966-2-1)."""
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def delta_e_2000(lab: FloatArray, other: FloatArray) -> FloatArray:
    """CIEDE2000 (...) of two sets of CIELAB colours (..., 3), all weights 1 (ISO/CIE 11664-6; Sharma et al. 2005)."""
    l1, a1, b1 = np.moveaxis(np.asarray(lab, dtype=float), -1, 0)
    l2, a2, b2 = np.moveaxis(np.asarray(other, dtype=float), -1, 0)
    mean_c7 = ((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2) ** 7
    g = 0.5 * (1 - np.sqrt(mean_c7 / (mean_c7 + _SEVENTH_POWER_OF_25)))
    a1, a2 = (1 + g) * a1, (1 + g) * a2
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, a1)) % 360, np.degrees(np.arctan2(b2, a2)) % 360
    grey = c1 * c2 == 0
    turn = np.where(grey, 0, (h2 - h1 + 180) % 360 - 180)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn) / 2)
    apart, total = np.abs(h1 - h2), h1 + h2
    mean_h = np.where(apart <= 180, total / 2, np.where(total < 360, (total + 360) / 2, (total - 360) / 2))
    mean_h = np.radians(np.where(grey, total, mean_h))
    mean_l, mean_c = (l1 + l2) / 2, (c1 + c2) / 2
    t = (
        1 - 0.17 * np.cos(mean_h - np.pi / 6) + 0.24 * np.cos(2 * mean_h)
        + 0.32 * np.cos(3 * mean_h + np.radians(6)) - 0.20 * np.cos(4 * mean_h - np.radians(63))
    )  # fmt: skip
    s_l = 1 + 0.015 * (mean_l - 50) ** 2 / np.sqrt(20 + (mean_l - 50) ** 2)
    s_c, s_h = 1 + 0.045 * mean_c, 1 + 0.015 * mean_c * t
    theta = np.radians(30) * np.exp(-(((np.degrees(mean_h) - 275) / 25) ** 2))
    r_c = 2 * np.sqrt(mean_c**7 / (mean_c**7 + _SEVENTH_POWER_OF_25))
    dl, dc, dh = (l2 - l1) / s_l, (c2 - c1) / s_c, dh / s_h
    return np.sqrt(np.maximum(dl**2 + dc**2 + dh**2 - np.sin(2 * theta) * r_c * dc * dh, 0))
