"""Calibration check with images of the matt plane: does the lamp agree with the calibration, and what has changed?

The plane is the one that the lamp was calibrated on, so that its albedo's uncertainty cancels. The covariances of
intensity, lobe, flat field, lamp's and camera's place are those that the set in use states; the plane's pose is
estimated anew. Together they count the geometry twice, once by itself and once in the lobe's covariance, so that the
check raises alarms too seldom rather than too often.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from acquisition import image_values, photometry
from acquisition.calibrate import change_test, plane_shading
from acquisition.calibrate.change_test import ChangeTest, Group, GroupTest
from acquisition.calibrate.plane_shading import Known, Placing, PlaneImage
from acquisition.calibrate.stated_values import StatedLamp
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import LobeResult
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.rounding import percent

INTENSITY, LOBE, LAMP_PLACE = "intensity", "lobe", "lamp"

LEAST_IMAGES = 4
"""Number of images of the plane from which intensity and lobe can be distinguished."""

ROUNDS = 3
"""Rounds that linearise the model about the most likely geometry: the plane's sag matters to second order."""

ALBEDO_STAYS = 1e-3
"""1 σ of a change of the plane's albedo, as a fraction: paper yellows by less in a year indoors."""


@dataclass(frozen=True)
class LampCheck:
    """The tests and, in the order of the images, each image's mean of ln measured over predicted brightness."""

    found: ChangeTest
    offsets: tuple[float, ...]


def known_of(stated_lamp: StatedLamp, calibration: Calibration, albedo: float, size_m: tuple[float, float]) -> Known:
    """Returns what the check takes as given; the board is `size_m` wide and high."""
    covariances = np.array(stated_lamp.lamp.covariance), np.array(stated_lamp.hand_eye.covariance)
    return Known(calibration, albedo, ALBEDO_STAYS, *covariances, size_m)


def check(
    images: Sequence[PlaneImage], placing: Placing, known: Known, lobe: LobeResult, albedo_sigma: float
) -> LampCheck:
    """Tests images of the plane in one placing against the lamp as stated.

    `albedo_sigma` is that of the plane, a fraction; the stated covariance of the intensity contains it. Raises RigError
    calibration.infeasible with too few images.
    """
    seen = [within for image in images if len((within := _within_lobe(image, placing, known, lobe)).values)]
    if len(seen) < LEAST_IMAGES:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"{len(seen)} images show the plane neither too dark nor clipped, and {LEAST_IMAGES} are needed: is the "
            "lamp on, and does the plane lie face up in the object's place?",
        )
    of_lobe = np.array(lobe.covariance)
    of_lobe[0, 0] = max(of_lobe[0, 0] - albedo_sigma**2, 0.0) + known.albedo_sigma**2
    covariance = block_diag(of_lobe, np.array(lobe.flat_field_covariance), *known.covariances([placing]))
    moving = slice(len(of_lobe) + len(lobe.flat_field), len(covariance))
    information, gradient, offsets = _compared(seen, placing, known, lobe, np.zeros(moving.stop - moving.start))
    for _ in range(ROUNDS - 1):
        most_likely = covariance @ np.linalg.solve(np.eye(len(covariance)) + information @ covariance, gradient)
        information, gradient, offsets = _compared(
            seen, placing, known, lobe, np.asarray(most_likely[moving], np.float64)
        )
    groups = (
        Group(INTENSITY, (0,)),
        Group(LOBE, tuple(range(1, len(of_lobe)))),
        Group(LAMP_PLACE, tuple(range(moving.start, moving.start + 3))),
    )
    return LampCheck(change_test.find_changes(information, gradient, covariance, groups), offsets)


def sentence(test: GroupTest) -> str:
    """Describes a group's change, for people."""
    if test.group.name == INTENSITY:
        change = float(np.expm1(test.change[0]))
        by, than = percent(abs(change)), "brighter" if change > 0 else "dimmer"
        return f"the lamp is {by} {than} (or the aperture has changed)"
    if test.group.name == LOBE:
        return f"the lamp's lobe differs by up to {percent(float(np.abs(np.expm1(test.change)).max()))}"
    return f"the lamp's place in the tool's frame, by {1e3 * float(np.linalg.norm(test.change)):.2f} mm"


def _compared(
    images: Sequence[PlaneImage], placing: Placing, known: Known, lobe: LobeResult, off: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[float, ...]]:
    """Information (P, P) and gradient (P,) of the images at the stated values, linearised where the geometry (11 + 6,)
    is `off`; mean of ln measured over predicted brightness for each image."""
    design, rest, number = _linearised(images, placing, known, lobe, off)
    first = len(lobe.covariance) + len(lobe.flat_field)
    information, gradient = np.zeros((design.shape[1], design.shape[1])), np.zeros(design.shape[1])
    for one, image in enumerate(images):
        rows = number == one
        own_lamp = lobe.lamp_sigma_m * design[rows, first : first + 3]
        weight = np.linalg.inv(
            np.diag(lobe.patch_sigma**2 + image.noise**2) + lobe.image_sigma**2 + own_lamp @ own_lamp.T
        )
        information += design[rows].T @ weight @ design[rows]
        gradient += design[rows].T @ weight @ rest[rows]
    return information, gradient, tuple(float(rest[number == one].mean()) for one in range(len(images)))


def _linearised(
    images: Sequence[PlaneImage], placing: Placing, known: Known, lobe: LobeResult, off: FloatArray
) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Derivatives (N, P) of ln brightness by what may have changed, where the geometry (11 + 6,) is `off`; ln measured
    over brightness predicted by the stated values (N,); number of the image (N,)."""
    here = [_in_first_placing(image) for image in images]
    knots, logs = lobe.lobe.knots_rad, np.log(np.array(lobe.lobe.factors))[1:]
    tilt = np.array(lobe.lobe.tilt)
    seen = plane_shading.seen_patches(here, [placing], known, off)
    design = plane_shading.columns(here, seen, knots, known)
    side = 1 + seen.side @ tilt
    tilted = slice(len(knots), len(knots) + 2)
    design[:, tilted] = seen.side / side[:, None]
    pixels = np.concatenate([image.pixels for image in here])
    flat = image_values.flat_terms(pixels, known.calibration.width, known.calibration.height) @ np.array(
        lobe.flat_field
    )
    predicted = (
        np.log(known.calibration.lamp_intensity * known.albedo) + seen.log_shading + np.log(side) + flat
        + photometry.lobe_spline(knots, seen.angle)[:, 1:] @ logs
    )  # fmt: skip
    sources = plane_shading.derivatives(here, [placing], known, knots, np.r_[logs, tilt], off)
    rest = np.log(np.concatenate([image.values for image in here])) - predicted + sources @ off
    number = np.repeat(np.arange(len(here)), [len(image.values) for image in here])
    return np.hstack([design, sources]), rest, number


def _within_lobe(image: PlaneImage, placing: Placing, known: Known, lobe: LobeResult) -> PlaneImage:
    """Returns the image with only the patches lit at angles for which the lobe is stated."""
    if not len(image.values):
        return image
    still = np.zeros(plane_shading.PLACED + 6)
    angle = plane_shading.seen_patches([_in_first_placing(image)], [placing], known, still).angle
    return plane_shading.selected(image, angle <= lobe.lobe.knots_rad[-1])


def _in_first_placing(image: PlaneImage) -> PlaneImage:
    return PlaneImage(image.name, 0, image.base_from_tool, image.points, image.pixels, image.values, image.noise)
