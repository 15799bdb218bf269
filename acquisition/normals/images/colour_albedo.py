"""Colours of a mosaic sensor's albedo: three channels at every pixel, white-balanced, in linear sRGB where calibrated.

A solve gives each site the albedo of its own channel. Albedo is free of shading, so interpolation to the other sites
mixes colours of the surface, not shadows or highlights.
"""

from dataclasses import replace

import numpy as np

from acquisition import mosaic
from acquisition.models.base import Float32Array
from acquisition.models.calibration import Calibration
from acquisition.models.result import NormalMap

SRGB, CAMERA = "linear sRGB, white D65", "the camera's own R, G, B"
"""Values of `NormalMap.notes["colour"]`: the colour space of `albedo_rgb`."""

CELL_SHARES = np.array([0.25, 0.5, 0.25], np.float32)
"""Shares of R, G and B in a cell of the mosaic."""


def of_sites(normal_map: NormalMap, calibration: Calibration) -> NormalMap:
    """Adds the colours to the result of a mosaic sensor: `albedo` (H, W) becomes the mean over the channels at each
    pixel, `albedo_rgb` (H, W, 3) the channels."""
    height, width = normal_map.albedo.shape
    channel = mosaic.of_calibration(calibration, slice(0, height), slice(0, width))
    if channel is None:
        return normal_map
    white = mosaic.white(calibration)
    channels = mosaic.interpolated(normal_map.albedo / white[channel], channel, normal_map.mask)
    return replace(
        normal_map,
        albedo=(channels @ (CELL_SHARES * white)).astype(np.float32),
        albedo_rgb=in_srgb(channels, calibration),
        notes=normal_map.notes | {"colour": CAMERA if calibration.colour is None else SRGB},
    )


def channel_ratios(
    normal_map: NormalMap, calibration: Calibration, rows: np.ndarray, columns: np.ndarray
) -> Float32Array:
    """Returns the values (C, K) of a mosaic's red, green and blue sites at some pixels over their mean, ones (1, K) of
    a monochrome sensor. The brightest channel is the first to clip."""
    colours = normal_map.albedo_rgb
    if calibration.sensor.mosaic is None or colours is None:
        return np.ones((1, len(rows)), np.float32)
    channels = colours[rows, columns]
    if normal_map.notes.get("colour") == SRGB and calibration.colour is not None:
        channels = np.linalg.solve(np.array(calibration.colour.matrix), channels.T.astype(np.float64)).T
    mean = np.maximum(normal_map.albedo[rows, columns], np.float32(1e-6))
    return np.maximum((channels * mosaic.white(calibration)).T / mean, 0).astype(np.float32)


def in_srgb(channels: Float32Array, calibration: Calibration) -> Float32Array:
    """Multiplies white-balanced R, G, B (..., 3) by the calibration's matrix; without one they stay the same."""
    if calibration.colour is None:
        return channels
    return (channels @ np.array(calibration.colour.matrix, np.float32).T).astype(np.float32)
