"""Three channels of RGB images as measurements of one normal, each with an albedo of its own.

y_cf = ρ_c n·s_f: the channels share the normal, and under white light an image's values in them are in the ratio of the
albedos. Given that ratio q_c (mean 1), what the three say of an image is Σ y_c / Σ q_c, over the channels that are not
clipped: of photon counts (Poisson) that is the maximum-likelihood estimate, so that nothing is lost by solving it in
place of the three, and where one channel is clipped the others still count. The ratio itself is Σ_f y_cf over the
images in which no channel is clipped, the maximum-likelihood estimate again, from all images of the pixel.
"""

import numpy as np

from acquisition.models.base import BoolArray, Float32Array

MIN_SHARE = 0.3
"""Least Σ q of the channels that are left, of 3: of less, the image's value is mostly noise, and counts as clipped."""


def ratios(values: Float32Array, counted: BoolArray) -> Float32Array:
    """Albedo of each channel over their mean (..., C), from values (F, ..., C) of the images `counted` (F, ...); ones
    where there are none."""
    total = np.sum(np.maximum(values, 0) * counted[..., None], axis=0)
    mean = total.mean(axis=-1, keepdims=True)
    return np.where(mean > 0, total / np.maximum(mean, 1e-12), 1).astype(np.float32)


def combined(values: Float32Array, clipped: BoolArray) -> tuple[Float32Array, BoolArray]:
    """One value (F, ...) for the channels of each measurement, and where it is clipped, from values and clipped ones
    (F, ..., C): the mean of the channels, had none been clipped."""
    channels = values.shape[-1]
    whole: BoolArray = np.logical_not(np.asarray(clipped.any(axis=-1)))
    shares = ratios(values, whole) * ~clipped
    left = np.sum(shares, axis=-1)
    total = np.sum(np.where(clipped, 0, values), axis=-1)
    gone = left < MIN_SHARE * channels / 3
    return np.where(gone, values.mean(axis=-1), total / np.maximum(left, 1e-6)).astype(np.float32), gone
