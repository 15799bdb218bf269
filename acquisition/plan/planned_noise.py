"""Noise model of planned images: heteroscedastic variance of y, as expected and, to choose lights by, cautiously.

What is expected is not what calibration alone says. The final solve finds each image's intensity from all pixels
together, so that a part of that error remains; and depth is an unknown of its own, in the plan as in the solve, so that
the error of the light's direction is that of the lamp's position, and turns y only as far as the light falls aslant.
What pixels do not share, the sensor's noise, is halved when normals are made those of a surface; what lamps do wrong is
not. Forecasts are made with that, and the information of the images so far is reweighted by it. Lights are chosen more
cautiously, as if errors of intensity and depth stayed in full, as they do on flat surfaces: so the choice does not hang
on how much the final solve will put right.

Indirect radiance (interreflection) is subtracted by a prediction whose error is proportional to that radiance, not to
the lamp's: dark measurements beside it are worth less. Its brightness is known from the images so far.

Highlights on a glossy surface are another error of the images: where the pilot shows some, lights that would throw
them at many pixels are worth less.

Sub-pixel curvature (discretisation) error: where the surface bends within a pixel, its normal is a mixture, and no
light removes that variance. It is estimated from second differences of the normals round the pixel.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import HIGHLIGHT, NormalMap

SELF_CALIBRATION_FACTOR = 0.3
"""Self-calibration factor of σ: share of an image's intensity error that remains and matters: of 0.010 at eight images
0.0055, most of it common to all images, which only the albedo feels. Planning with the covariance of the intensities
found (a Schur complement over images) in place of this number changes the errors by less than can be measured."""

INTEGRABILITY_FACTOR = 0.5
"""Integrability factor of variance: part of the independent pixel noise that remains once normals are those of a
surface. Measured over expected mean errors of eight images are 0.83–1.0 of smooth objects and figures with it, 1.0–1.3
of parts and fine relief."""

SUBPIXEL_FACTOR = 0.09
"""Sub-pixel factor of σ: error of a pixel's normal as a share of the second difference of the normals round it, for
relief and steps alike: 0.09–0.12 of fine relief where these are 4–40°."""

DIFFERENCE_NOISE_RAD = float(np.radians(3.0))
DIFFERENCE_NOISE_SIGMAS = 3.0
"""Second differences of the first size, or of the second in units of the pixel's own σ, are the pilot's own noise."""

INDIRECT_SIGMA = 0.4
"""1 σ of the residual indirect radiance, as a share of it, for each light: not only what differs from light to light,
by which the solver weighs (`photometry.PREDICTED_INDIRECT_SIGMA`). Of single lights a tenth is left, but what is missed
under all lights alike, a fifth and more, also turns normals least where they see many lights well: eight images
path-traced with 0.4 come out at 0.98–0.99 times the error of two rings, without it at 1.03."""

GLOSSY_SHARE = 0.03
"""Share of pixels with a highlight in some image above which a surface is glossy: 0.5–2 % on matt ones, 4–13 % on
slightly glossy ones."""

DEFAULT_LOBE_STRENGTH, DEFAULT_LOBE_EXPONENT = 0.15, 30.0
"""The lobe where nothing but the presence of highlights is known, its strength in units of albedo. What is planned for
is the error that the final solve leaves, not the highlight: lights that keep clear of all highlights would tell nothing
of the lobe, and flat surfaces then take it for a shift of the object."""


@dataclass(frozen=True)
class Gloss:
    """Variance of y from highlights: (sigma |s| (n·h)^exponent)², h half way between lamp and camera."""

    sigma: float = 0.0
    exponent: float = DEFAULT_LOBE_EXPONENT


DIFFUSE = Gloss()


def gloss(normal_map: NormalMap) -> Gloss:
    """Highlight noise: from the lobe that the solver fitted, else from the share of pixels flagged as highlights."""
    sigma, lobe = photometry.PREDICTED_HIGHLIGHT_SIGMA, normal_map.notes.get("lobe")
    if lobe is not None and lobe["strength"] > 0:
        return Gloss(sigma * float(lobe["strength"]), float(lobe["exponent"]))
    highlighted = np.any(normal_map.flags[:, normal_map.mask] & HIGHLIGHT, axis=0)
    return Gloss(sigma * DEFAULT_LOBE_STRENGTH) if highlighted.size and np.mean(highlighted) > GLOSSY_SHARE else DIFFUSE


def variance(
    value: FloatArray | Float32Array, cosine: FloatArray | Float32Array, strength: FloatArray | Float32Array,
    distance: FloatArray | Float32Array, level: FloatArray, calibration: Calibration, indirect: Float32Array, *,
    cautious: bool = False,
) -> FloatArray:  # fmt: skip
    """Variance of y (K, P) of lights at `distance` (K, P) in m that fall on a surface of strength ρ|s| (K, P) at
    `cosine` (K, P), exposed so that y = 1 gives `level` (K,) of full scale; as expected, or cautiously.

    `indirect` (P,) is the indirect radiance, in y.
    """
    indirect_variance = (INDIRECT_SIGMA * indirect) ** 2
    if cautious:
        assumed = photometry.noise(calibration, list(level / calibration.lamp_intensity), float(np.mean(distance)))
        assumed = replace(assumed, shot=INTEGRABILITY_FACTOR * assumed.shot, floor=INTEGRABILITY_FACTOR * assumed.floor)
        sensor_and_lamp = assumed.variance(np.asarray(value, np.float64), np.asarray(strength, np.float64))
        return np.asarray(sensor_and_lamp + indirect_variance)
    shot, floor = photometry.sensor_noise(calibration, list(level / calibration.lamp_intensity))
    lamp_angle = calibration.lamp_position_sigma_m / distance
    intensity_variance = SELF_CALIBRATION_FACTOR**2 * (calibration.intensity_sigma**2 + (2 * lamp_angle) ** 2)
    direction_variance = lamp_angle**2 * np.clip(1 - cosine**2, 0, 1)
    pixel_variance = shot[:, None] * value + floor[:, None] + photometry.FLAT_FIELD_SIGMA**2 * value**2
    return np.asarray(
        INTEGRABILITY_FACTOR * pixel_variance
        + intensity_variance * value**2
        + direction_variance * strength**2
        + indirect_variance
    )


def solved_variance(
    value: Float32Array, strength: Float32Array, distance_m: float, level: FloatArray, calibration: Calibration,
    normal_map: NormalMap, indirect: Float32Array,
) -> FloatArray:  # fmt: skip
    """The variance (K, P) by which the solver of `normal_map` weighted values of such images; `indirect` as above."""
    assumed = photometry.noise(calibration, list(level / calibration.lamp_intensity), distance_m)
    intensity = normal_map.noise.get("intensity", assumed.intensity)
    direction = normal_map.noise.get("direction", assumed.direction)
    lamps = (intensity * value) ** 2 + (direction * strength) ** 2
    predicted = (photometry.PREDICTED_INDIRECT_SIGMA * indirect) ** 2
    return assumed.shot[:, None] * value + assumed.floor[:, None] + lamps + predicted


def curvature_variance(normal_map: NormalMap, rows: np.ndarray, columns: np.ndarray) -> Float32Array:
    """Sub-pixel curvature (discretisation) variance (P,) of pixels' normals, rad², from second differences."""
    height, width = normal_map.mask.shape
    normal = normal_map.normals[rows, columns].astype(np.float64)
    squared_difference = np.zeros(len(rows))
    for down, right in ((0, 1), (1, 0)):
        before = np.maximum(rows - down, 0), np.maximum(columns - right, 0)
        after = np.minimum(rows + down, height - 1), np.minimum(columns + right, width - 1)
        inside: BoolArray = normal_map.mask[before] & normal_map.mask[after]
        second_difference = np.nan_to_num(normal_map.normals[before] + normal_map.normals[after] - 2 * normal)
        squared_difference += np.where(inside, np.sum(second_difference**2, axis=1), 0.0)
    sigma = np.radians(np.nan_to_num(normal_map.sigma_deg[rows, columns], nan=40.0))
    return (
        SUBPIXEL_FACTOR**2
        * np.maximum(squared_difference / 2 - DIFFERENCE_NOISE_RAD**2 - (DIFFERENCE_NOISE_SIGMAS * sigma) ** 2, 0.0)
    ).astype(np.float32)
