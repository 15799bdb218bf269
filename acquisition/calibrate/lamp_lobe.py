"""Intensity and lobe of the lamp, and the camera's flat field, from images of a matt plane under many lamp poses.

The plane's ChArUco border gives its pose and the arm gives the lamp's, so that only the lamp is unknown in the
brightness of each patch of the blank middle. In logarithms all unknowns add up: the intensity, a spline over the angle
off the axis, the lamp's brighter side, the camera's sensitivity over the image. Weighted linear least squares estimates
them together with the uncertain geometry (lamp, camera, each placing of the plane), each image's own brightness and
each image's own place of the lamp, all within their priors; the covariance therefore contains all of it. The lamp has
its own place in each image because a displacement of 0.3 mm shades all patches of the image alike, so that their errors
are not independent. The side's term and the geometry are linearised anew in each round.

No LED is a cosᵘ, and the number of knots that a lobe needs differs from lamp to lamp. The spline that predicts held-out
images best has as much bias as noise, but a covariance contains the noise alone. So the lobe gets the largest number of
knots whose prediction is as good within one standard error (undersmoothing: Hall, "Effect of Bias Estimation on
Coverage Accuracy of Bootstrap Confidence Intervals for a Probability Density", 1992), which makes the bias small beside
the stated errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from acquisition import geometry, image_values, lamp_pose, photometry
from acquisition.calibrate.plane_shading import (
    PLACED,
    Known,
    Placing,
    PlaneImage,
    SeenPatches,
    columns,
    derivatives,
    seen_patches,
)
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration, FlatField, LampLobe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.rounding import percent

MIN_IMAGES = 10
"""Least number of images of the plane: fewer do not separate lobe, sides and flat field."""

KNOTS = (4, 5, 6, 8, 10, 12, 14, 17)
"""Numbers of knots that are tried: 8 to 12 predict real LEDs behind lenses best."""

FOLDS = 5
"""Folds of the cross-validation over images."""

MIN_ANGLE_DEG = 15.0
"""Least angle off the axis that the images must reach, degrees."""

FLAT_TERMS = 5
"""Terms of the flat field: u, v, u², u v, v², u and v from the image's centre in half diagonals."""

PRIOR_SIGMA = 0.3
"""Prior 1 σ of the logarithm of a knot's factor, of tilt and of flat-field terms: only for what no image shows."""

IMAGE_SIGMA_START, PATCH_SIGMA_START, LAMP_SIGMA_START_M = 0.005, 0.002, 2e-4
"""Initial 1 σ of an image's and of a patch's brightness, as fractions, and of the lamp's place in an image, m, per
axis."""

IMAGE_SIGMA_FLOOR, PATCH_SIGMA_FLOOR, LAMP_SIGMA_FLOOR_M = 1e-4, 1e-4, 1e-5
"""Least values of these."""

MAX_PATCH_SIGMA = 0.03
"""1 σ of a patch about the fit above which plane, poses or lamp are not as stated."""

ROUNDS = 12
"""Rounds of the fit: tilt and geometry are not quite linear, and the variances follow from the residuals."""


@dataclass(frozen=True)
class LobeFit:
    """The lamp's intensity as in `Calibration`, its lobe and the flat field (5,).

    `covariance` (K + 2, K + 2) of ln intensity, the logarithms of all factors but the first, and the tilt;
    `flat_covariance` (5, 5) of the flat field. `image_sigma`, `patch_sigma`: 1 σ of an image's and of a patch's
    brightness, as fractions; `lamp_sigma_m`: of the lamp's place in one image, along each axis; `offsets` (I,) of each
    image's ln brightness; `held_out`: residual by number of knots.
    """

    lamp_intensity: float
    lobe: LampLobe
    flat_field: FloatArray
    covariance: FloatArray
    flat_covariance: FloatArray
    image_sigma: float
    patch_sigma: float
    lamp_sigma_m: float
    offsets: FloatArray
    held_out: dict[int, float]

    def calibrated(self, calibration: Calibration) -> Calibration:
        """Returns a calibration with this lamp."""
        return calibration.model_copy(
            update={
                "lamp_intensity": self.lamp_intensity, "lobe": self.lobe, "intensity_sigma": self.image_sigma,
                "lamp_position_sigma_m": max(calibration.lamp_position_sigma_m, self.lamp_sigma_m),
                "flat_field": FlatField.model_validate(
                    {"terms": self.flat_field.tolist(), "covariance": self.flat_covariance.tolist()}
                ),
            }
        )  # fmt: skip


def fit(images: Sequence[PlaneImage], placings: Sequence[Placing], known: Known) -> LobeFit:
    """Fits intensity, lobe, sides and flat field to all patches by linear least squares in logarithms.

    Raises RigError calibration.infeasible for too few images, images all under the lamp's axis, or a plane whose
    brightness is not that of a matt one.
    """
    if len(images) < MIN_IMAGES:
        raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, f"{len(images)} images of the plane: {MIN_IMAGES} are needed")
    still = np.zeros(PLACED + 6 * len(placings))
    seen = seen_patches(images, placings, known, still)
    reach = float(seen.angle.max())
    if np.degrees(reach) < MIN_ANGLE_DEG:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"The images show the plane only up to {np.degrees(reach):.0f}° off the lamp's axis: tilt the lamp by up "
            "to 40° away from the plane, to different sides",
        )
    held_out = _held_out_residuals(images, placings, known, seen, reach)
    # The standard error of a root mean square of N is its 1/√(2N).
    most = min(held_out.values()) * (1 + 1 / np.sqrt(2 * len(seen.angle)))
    count = max(count for count, residual in held_out.items() if residual <= most)
    return _solve(images, placings, known, _knots(reach, count), held_out)


def normal_error_deg(
    images: Sequence[PlaneImage], placing: Placing, calibration: Calibration, flat_field: FloatArray
) -> float:
    """Mean angle between the plane's normal by its border and by photometric stereo on its patches, degrees.

    The images are of one placing, with the same patches in all of them. A placing that took no part in the fit verifies
    the calibration. Each patch is solved by least squares over the images. Raises RigError calibration.infeasible with
    fewer than four images.
    """
    if len(images) < 4:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE, f"{len(images)} images of the plane to verify with: 4 are needed"
        )
    common = set.intersection(*({tuple(np.round(point, 6)) for point in image.points} for image in images))
    lights = [_light(image, calibration) for image in images]
    to_view = geometry.VIEW_FROM_CAMERA @ placing.camera_from_board
    points = np.array(sorted(common))
    vectors = photometry.light_vectors(
        geometry.transform(to_view, points).T.astype(np.float32), photometry.lamps(lights), calibration
    ).astype(float)
    values = np.stack([_values_at(image, points, calibration, flat_field) for image in images])
    normal = -to_view[:3, 2]
    errors: list[float] = []
    for patch in range(len(points)):
        found = np.linalg.lstsq(vectors[:, :, patch], values[:, patch], rcond=None)[0]
        errors.append(float(np.arctan2(np.linalg.norm(np.cross(found, normal)), found @ normal)))
    return float(np.degrees(np.mean(errors)))


def _light(image: PlaneImage, calibration: Calibration) -> Light:
    return lamp_pose.light_from_tool(image.base_from_tool, calibration)


def _values_at(image: PlaneImage, points: FloatArray, calibration: Calibration, flat_field: FloatArray) -> FloatArray:
    """Returns the normalised values y of an image at some of its patches."""
    row = {tuple(np.round(point, 6)): number for number, point in enumerate(image.points)}
    at = [row[tuple(point)] for point in points]
    sensitivity = np.exp(image_values.flat_terms(image.pixels[at], calibration.width, calibration.height) @ flat_field)
    return image.values[at] / sensitivity / calibration.lamp_intensity


def _knots(reach_rad: float, count: int) -> tuple[float, ...]:
    return tuple(np.linspace(0.0, reach_rad, count).tolist())


def _held_out_residuals(
    images: Sequence[PlaneImage], placings: Sequence[Placing], known: Known, seen: SeenPatches, reach: float
) -> dict[int, float]:
    """Held-out residual, as a fraction, by number of knots; the uncertain geometry is fitted along."""
    number = np.repeat(np.arange(len(images)), [len(image.values) for image in images])
    target = np.log(np.concatenate([image.values for image in images])) - seen.log_shading
    still = np.zeros(PLACED + 6 * len(placings))
    sources = derivatives(images, placings, known, _knots(reach, 2), np.zeros(3), still)
    own = np.hstack([np.ones((len(target), 1)), sources[:, :3]])
    roots = [np.asarray(np.linalg.inv(np.linalg.cholesky(one)), np.float64) for one in known.covariances(placings)]
    found = dict[int, float]()
    for count in KNOTS:
        design = columns(images, seen, _knots(reach, count), known)[:, 1:]
        prior = block_diag(np.eye(design.shape[1]) / PRIOR_SIGMA, *roots)
        scale = PATCH_SIGMA_START
        found[count] = scale * _held_out(np.hstack([design, sources]) / scale, target / scale, prior, number, own)
    return found


def _held_out(columns: FloatArray, target: FloatArray, prior: FloatArray, number: np.ndarray, own: FloatArray) -> float:
    """Root mean square residual of images that are predicted by fits to the others.

    Each image's own unknowns, columns of `own` (N, 4), are projected out: its brightness and its place of the lamp are
    not errors of the lobe. `columns` (N, M) and `target` (N,) are in standard deviations, `prior` (M, M) is a root of
    the parameters' inverse prior covariance.
    """
    inside, within = columns.copy(), target.copy()
    for image in range(number.max() + 1):
        rows = number == image
        base = np.asarray(np.linalg.qr(own[rows])[0], np.float64)
        inside[rows] -= base @ (base.T @ columns[rows])
        within[rows] -= base @ (base.T @ target[rows])
    total = 0.0
    for fold in range(FOLDS):
        left = number % FOLDS == fold
        normal = inside[~left].T @ inside[~left] + prior.T @ prior
        solution = np.linalg.solve(normal, inside[~left].T @ within[~left])
        total += float(np.sum((within[left] - inside[left] @ solution) ** 2))
    return float(np.sqrt(total / len(target)))


def _prior_sigma(theta: FloatArray, covariance: FloatArray, some: slice, before: float) -> float:
    """Estimates the common 1 σ of unknowns: their squares over the number of them that the data determine.

    MacKay, "Bayesian Interpolation", 1992, eq. 4.8. It needs a tenth of the rounds of expectation–maximisation where
    the data hardly determine each unknown.
    """
    determined = theta[some].size - float(np.trace(covariance[some, some])) / before**2
    return float(np.sqrt(np.sum(theta[some] ** 2) / max(determined, 1.0)))


def _solve(
    images: Sequence[PlaneImage], placings: Sequence[Placing], known: Known, knots: tuple[float, ...],
    held_out: dict[int, float],
) -> LobeFit:  # fmt: skip
    count = len(knots) - 1
    tilt_at, flat_at, own = (
        slice(1 + count, 3 + count),
        slice(3 + count, 3 + count + FLAT_TERMS),
        3 + count + FLAT_TERMS,
    )
    number = np.repeat(np.arange(len(images)), [len(image.values) for image in images])
    values = np.log(np.concatenate([image.values for image in images]))
    noise = np.concatenate([image.noise for image in images])
    moving = slice(own, own + PLACED + 6 * len(placings))
    geometric = known.covariances(placings)
    prior = block_diag(
        np.zeros((1, 1)),
        np.eye(own - 1) / PRIOR_SIGMA**2,
        *(np.asarray(np.linalg.inv(one), np.float64) for one in geometric),
    )
    images_of = np.eye(len(images))[number]
    image_sigma, patch_sigma, lamp_sigma_m = IMAGE_SIGMA_START, PATCH_SIGMA_START, LAMP_SIGMA_START_M
    brightness = slice(moving.stop, moving.stop + len(images))
    lamp_of_image = slice(brightness.stop, brightness.stop + 3 * len(images))
    theta: FloatArray = np.zeros(lamp_of_image.stop)
    covariance: FloatArray = np.zeros((len(theta), len(theta)))
    for _ in range(ROUNDS):
        # Linearised at the present geometry: the slope of a plane that sags by 0.2 mm matters to second order.
        tilt, off = theta[tilt_at], theta[moving]
        seen = seen_patches(images, placings, known, off)
        design = columns(images, seen, knots, known)
        sources = derivatives(images, placings, known, knots, np.r_[theta[1 : 1 + count], tilt], off)
        side = 1 + seen.side @ tilt
        own_lamp = (images_of[:, :, None] * sources[:, None, :3]).reshape(len(values), -1)
        whole = np.hstack([design, sources, images_of, own_lamp])
        whole[:, tilt_at] = seen.side / side[:, None]
        target = values - seen.log_shading - np.log(side) + whole[:, tilt_at] @ tilt + sources @ off
        weight: FloatArray = 1 / (patch_sigma**2 + noise**2)
        full_prior = block_diag(prior, np.eye(len(images)) / image_sigma**2, np.eye(3 * len(images)) / lamp_sigma_m**2)
        covariance = np.asarray(np.linalg.inv(whole.T @ (weight[:, None] * whole) + full_prior), np.float64)
        theta = covariance @ (whole.T @ (weight * target))
        residual = target - whole @ theta
        leverage = np.sum((whole @ covariance) * whole, axis=1)
        # Expectation–maximisation: squares, plus the variance that the fit leaves.
        squares = float(np.mean(weight * (residual**2 + leverage)))
        excess = squares * float(np.mean(1 / weight)) - float(np.mean(noise**2))
        patch_sigma = max(float(np.sqrt(max(excess, 0.0))), PATCH_SIGMA_FLOOR)
        image_sigma = max(_prior_sigma(theta, covariance, brightness, image_sigma), IMAGE_SIGMA_FLOOR)
        lamp_sigma_m = max(_prior_sigma(theta, covariance, lamp_of_image, lamp_sigma_m), LAMP_SIGMA_FLOOR_M)
    if patch_sigma > MAX_PATCH_SIGMA:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"Patches differ by {percent(patch_sigma, 0)} from what a matt plane would show: check the plane's "
            "albedo and evenness, shadows on it, and whether lamp and camera were calibrated first",
        )
    stated = np.r_[0, 1 : 1 + count, tilt_at.start : tilt_at.stop]
    of_stated = covariance[np.ix_(stated, stated)]
    of_stated[0, 0] += known.albedo_sigma**2
    factors = np.exp(np.r_[0.0, theta[1 : 1 + count]])
    lobe = LampLobe(
        knots_rad=knots, factors=tuple(factors.tolist()), tilt=(float(theta[tilt_at][0]), float(theta[tilt_at][1]))
    )
    return LobeFit(
        float(np.exp(theta[0])) / known.albedo, lobe, theta[flat_at], of_stated, covariance[flat_at, flat_at],
        image_sigma, patch_sigma, lamp_sigma_m, theta[brightness], held_out,
    )  # fmt: skip
