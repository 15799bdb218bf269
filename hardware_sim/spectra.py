"""Spectra of the simulated cell: a white LED's light, a camera's three channels, surfaces, and a 24-patch chart.

A camera's value is the integral over wavelengths of light, reflectance and sensitivity. No camera's sensitivities are
linear combinations of the eye's, so no camera distinguishes all colours as the eye does, and a colour matrix leaves
residuals, here as on a bench. Sources of the data are named in `spectra.json`.
"""

import json
from functools import lru_cache
from pathlib import Path

import numpy as np

from acquisition.models.base import FloatArray

CELL_SHARES = np.array([0.25, 0.5, 0.25])
"""Shares of R, G, B sites in a mosaic's cell."""


@lru_cache(1)
def _data() -> dict[str, FloatArray]:
    stored = json.loads(Path(__file__).with_name("spectra.json").read_text(encoding="utf-8"))
    return {name: np.array(values, dtype=float) for name, values in stored.items() if name != "about"}


def _seen(reflectances: FloatArray) -> FloatArray:
    """Values (N, 3) of R, G, B for reflectances (N, L) under the LED; white has mean 1 over a mosaic's cell."""
    data = _data()
    response = data["camera"] * data["led"]
    return reflectances @ response.T / float(CELL_SHARES @ response.sum(axis=1))


def band_response() -> FloatArray:
    """Values (3, 3) of R, G, B for the bands of linear sRGB reflectance: channel = response @ reflectance."""
    return _seen(_data()["bands"]).T


def white() -> FloatArray:
    """Values (3,) of R, G, B on white; (R + 2 G + B)/4 is 1."""
    return _seen(np.ones((1, _data()["led"].size)))[0]


def chart_response() -> FloatArray:
    """Values (24, 3) of R, G, B on the chart's patches."""
    return _seen(_data()["patches"])


def chart_lab() -> FloatArray:
    """CIELAB (24, 3) of the patches under D50, observer 2°: what a spectrophotometer would state."""
    data = _data()
    weight = data["observer"] * data["d50"]
    white_xyz = weight.sum(axis=1)
    ratio = data["patches"] @ weight.T / white_xyz
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)
