"""Automatic exposure: times from a geometric series, so that a session needs few lamp-off frames.

Steps of ∛2 lose at most an eighth of a stop of light on average and let most lights of a dome share one or two times.
"""

import math

from acquisition.models.calibration import Calibration
from acquisition.models.camera_config import CameraConfig
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import UNPLANNED_FACTOR, Exposure

STEP = 2.0 ** (1 / 3)
"""Ratio of successive exposure times of the series."""

ASSUMED_ALBEDO = 0.6
"""Albedo assumed for the brightest parts of an object before its first frame; later frames correct it."""

MIN_FURTHER_FACTOR = 2.0
"""Least ratio of a second exposure time to the first; if limits allow only less, no second frame is taken."""

MAX_PREDICTED_LEVEL = 0.9
"""Largest predicted level, fraction of full scale: predictions are right within a few per cent; none may saturate."""


def require_in_range(wanted: Exposure, camera: CameraConfig) -> None:
    """Raises RigError request.invalid for exposures that the camera cannot make, naming its limits."""
    low, high = camera.min_exposure_s, camera.max_exposure_s
    if wanted.seconds is not None and not low <= wanted.seconds <= high:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"exposure.seconds is {wanted.seconds:g} s, but the camera's exposure times go from {low:g} to {high:g} s: "
            "choose a time in this range, or leave it out for an automatic exposure",
        )
    if wanted.plan == "planned" and wanted.seconds_per_light < low:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"exposure.seconds_per_light is {wanted.seconds_per_light:g} s, but the camera's shortest exposure time is "
            f"{low:g} s: allow at least as much for each light",
        )


def assumed_level(cell: CellConfig, calibration: Calibration) -> float:
    """Returns the level assumed before the first frame (inverse-square law), fraction of full scale per second."""
    return ASSUMED_ALBEDO * calibration.lamp_intensity * (calibration.reference_m / cell.dome.radius_m) ** 2


def for_level(level_per_s: float, wanted: Exposure, camera: CameraConfig) -> float:
    """Returns the longest exposure time, s, of the series that does not bring a level, in full scales per second, above
    the target; or the recipe's own time."""
    if wanted.seconds is not None:
        return in_range(wanted.seconds, camera)
    return series_value(wanted.target / max(level_per_s, 1e-9), camera)


def for_predicted_level(level_per_s: float, wanted: Exposure, camera: CameraConfig) -> float:
    """Returns the exposure time, s, of the series that brings a level, full scales per second, nearest to the target.

    For lights whose level a normal map predicts: half a step above the target, about a tenth, does not saturate.
    """
    most = max(wanted.target, min(wanted.target * STEP**0.5, MAX_PREDICTED_LEVEL))
    return for_level(level_per_s, wanted.model_copy(update={"target": most}), camera)


def further_times(exposure_s: float, wanted: Exposure, camera: CameraConfig) -> list[float]:
    """Returns exposure times, s, of a light's further frames if no plan gives them; the first frame took `exposure_s`.
    With planned exposures this is one time, UNPLANNED_FACTOR times as long or as long as the recipe's limits allow."""
    if wanted.plan == "fixed" or wanted.max_frames_per_light < 2:
        return []
    longest = min(UNPLANNED_FACTOR * exposure_s, wanted.seconds_per_light - exposure_s)
    longer = series_value(longest, camera) if longest > 0 else 0.0
    return [longer] if longer >= MIN_FURTHER_FACTOR * exposure_s else []


def series_value(exposure_s: float, camera: CameraConfig) -> float:
    """Returns the longest time of the series not above `exposure_s`, within the camera's range."""
    number = math.floor(math.log(exposure_s, STEP) + 1e-9)
    return in_range(round(STEP**number, 6), camera)


def in_range(exposure_s: float, camera: CameraConfig) -> float:
    """Clips an exposure time, s, to the camera's range."""
    return min(max(exposure_s, camera.min_exposure_s), camera.max_exposure_s)
