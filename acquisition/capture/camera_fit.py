"""Comparison of a connected camera with calibration and cell file, before anything moves."""

from acquisition.models.calibration import Calibration
from acquisition.models.camera import CameraCapabilities
from acquisition.models.camera_config import CameraConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.rounding import percent

FEW_BITS = 8
"""Bits per value up to which the quantisation of shaded pixels is coarser than any sensor's noise."""

SHADED = 0.05
"""Level, fraction of full scale, of the shaded pixel for which the warning states the loss by few bits."""


def require_fit(camera: CameraCapabilities, calibration: Calibration, config: CameraConfig) -> list[str]:
    """Returns warnings about what is allowed but costs accuracy.

    Raises RigError config.invalid naming each difference of the camera from the calibration or the cell file.
    """
    bits = calibration.sensor.bits
    wrong = [
        f"its frames have {camera.width} × {camera.height} pixels, but the calibration's have {calibration.width} × "
        f"{calibration.height}: set the size that was calibrated, or calibrate again"
        if (camera.width, camera.height) != (calibration.width, calibration.height)
        else "",
        f"its values have {camera.bits} bits, but the calibration's have {bits}: set another pixel format, or "
        "calibrate again"
        if camera.bits != bits
        else "",
        f"its sensor is {camera.mosaic or 'monochrome'}, but the calibration's is "
        f"{calibration.sensor.mosaic or 'monochrome'}: set the pixel format (or `mosaic`) that was calibrated, or "
        "`sensor.mosaic` in the calibration"
        if camera.mosaic != calibration.sensor.mosaic
        else "",
        f"its exposure times go from {camera.min_exposure_s:g} to {camera.max_exposure_s:g} s, but the cell file's "
        f"from {config.min_exposure_s:g} to {config.max_exposure_s:g} s: correct `min_exposure_s` and `max_exposure_s`"
        if config.min_exposure_s < camera.min_exposure_s * (1 - 1e-6)
        or config.max_exposure_s > camera.max_exposure_s * (1 + 1e-6)
        else "",
    ]
    if any(wrong):
        raise RigError(ErrorCode.CONFIG_INVALID, f"{camera.name}: {'; '.join(filter(None, wrong))}")
    return warnings(camera)


def warnings(camera: CameraCapabilities) -> list[str]:
    """Returns for people what is allowed but costs accuracy."""
    if camera.bits > FEW_BITS:
        return []
    step = 1 / (2**camera.bits - 1)
    return [
        f"{camera.name} has only {camera.bits} bits: with steps of {percent(step, 2)} of full scale, a pixel at "
        f"{percent(SHADED, 0)} of it is uncertain by {percent(step / 12**0.5 / SHADED)} (1 σ) from rounding "
        "alone, whatever the exposure"
    ]
