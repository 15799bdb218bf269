"""Three channels of RGB images as measurements of one normal, each with an albedo of its own.

v_cf = e_cf ρ_c n·s_f: the channels share the normal, and an image's values in them are in the ratio of light e_cf times
albedo. Given the albedos' ratio q_c (mean 1), the three combine to one value Σ v_c / Σ q_c e_c, over the channels that
are not clipped. Of photon counts (Poisson) this is the maximum-likelihood estimate, so solving it instead of the three
loses nothing; a channel of little light has little weight, and if one channel is clipped the others still count. The
ratio q_c is that of Σ_f v_cf ē_f/e_cf, where ē_f is the mean of the channels, over the images in which no channel is
clipped. Under white light this is the maximum-likelihood estimate again, from all images of the pixel.
"""

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray


def ratios(values: Float32Array, counted: BoolArray, light: FloatArray) -> Float32Array:
    """Returns each channel's albedo over their mean (..., C), from values (F, ..., C) of the `counted` images (F, ...)
    under light (F, C); ones where there are none."""
    white = (light.mean(axis=1, keepdims=True) / light).astype(np.float32)
    albedo = np.sum(np.maximum(values, 0) * _per_image(white, values) * counted[..., None], axis=0)
    mean = albedo.mean(axis=-1, keepdims=True)
    return np.where(mean > 0, albedo / np.maximum(mean, 1e-12), 1).astype(np.float32)


def combined(values: Float32Array, clipped: BoolArray, light: FloatArray) -> tuple[Float32Array, BoolArray]:
    """Combines the channels of each measurement to one value (F, ...) per unit of light, and marks where it is clipped.
    Estimates the mean of channels without clipping, from values and clipped ones (F, ..., C) under light (F, C)."""
    whole: BoolArray = np.logical_not(np.asarray(clipped.any(axis=-1)))
    each = _per_image(light.astype(np.float32), values)
    left = np.sum(ratios(values, whole, light) * each * ~clipped, axis=-1)
    total = np.sum(np.where(clipped, 0, values), axis=-1)
    every = np.broadcast_to(each, values.shape).sum(axis=-1)
    # If less than a ninth of the light is left, relative noise is over three times that of all channels.
    gone = left * photometry.SETTINGS.outlying_deviations**2 < every
    unknown = values.sum(axis=-1) / every
    return np.where(gone, unknown, total / np.maximum(left, 1e-6 * every)).astype(np.float32), gone


def _per_image(light: Float32Array, values: Float32Array) -> Float32Array:
    """Reshapes light (F, C) so that it multiplies values (F, ..., C)."""
    return light.reshape(len(light), *(1,) * (values.ndim - 2), -1)
