"""Results of a calibration of the response as their files hold them: values, the photon-transfer picture, advice."""

from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import numpy as np

from acquisition.calibrate.board_results import now
from acquisition.calibrate.response import ResponseFit
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import ResponseResult
from acquisition.models.rounding import percent

MAX_ROOM_OVER_LAMP = 0.01
"""Ratio of room light to the lamp's above which it should be darkened: subtraction leaves its noise and flicker."""

MAX_BEND = 0.02
"""Bend above which a sensor counts as not linear: normals are then wrong by tenths of a degree."""

DRIFT_SIGMAS = 3.0
"""Multiple of its 1 σ from which a trend of the lamp's brightness counts."""


def result(found: ResponseFit, hashes: Mapping[str, str]) -> ResponseResult:
    """Result of a calibration of the response; `hashes` of all images by name."""
    black, gain, read_noise, full_well, bend = found.values.tolist()
    return ResponseResult.model_validate(
        {
            "made_at": now(), "version": metadata.version("lightpose"), "width": found.size[0],
            "height": found.size[1], "black_level_dn": black, "gain_e_per_dn": gain, "read_noise_e": read_noise,
            "full_well_e": full_well, "full_by": found.full, "nonlinearity": bend,
            "covariance": found.covariance.tolist(), "room_per_s": found.room[0],
            "brightest_room_per_s": found.room[1], "room_over_lamp": found.room_over_lamp,
            "lamp_sigma": found.lamp_sigma, "lamp_drift_per_h": found.drift[0],
            "lamp_drift_sigma_per_h": found.drift[1],
            "exposures": [
                {
                    "exposure_s": one.exposure_s, "mean_dn": one.mean_dn, "dark_dn": one.dark_dn,
                    "lamp": list(one.lamp), "nonlinear": one.nonlinear,
                }
                for one in found.points
            ],
            "defects": [{"column": column, "row": row, "kind": kind} for column, row, kind in found.defects],
            "images": dict(hashes),
        }
    )  # fmt: skip


def with_response(calibration: Calibration, found: ResponseResult) -> Calibration:
    """Returns a calibration with another sensor; the lamp's intensity, relative to full scale, follows black level."""
    update = found.model_dump(include={"black_level_dn", "gain_e_per_dn", "read_noise_e", "full_well_e"})
    sensor = calibration.sensor.model_copy(update=update)
    intensity = calibration.lamp_intensity * calibration.sensor.full_scale_dn / sensor.full_scale_dn
    return calibration.model_copy(update={"sensor": sensor, "lamp_intensity": intensity, "made_at": found.made_at})


def advice(found: ResponseResult) -> list[str]:
    """Returns what to correct, for people; nothing if the result is good."""
    said: list[str] = []
    if found.room_over_lamp > MAX_ROOM_OVER_LAMP:
        said.append(
            f"With the lamp off the room gives {percent(found.room_over_lamp)} of the lamp's light: darken the room."
        )
    if abs(found.nonlinearity) > MAX_BEND:
        said.append(
            f"The response bends by {percent(found.nonlinearity, signed=True)} at full scale: switch off the camera's "
            "gamma, noise reduction and automatic functions."
        )
    if found.full_by == "not reached":
        said.append(
            "No pixel was full, so only a lower bound of the full well is known: put something white before the camera."
        )
    if abs(found.lamp_drift_per_h) > DRIFT_SIGMAS * found.lamp_drift_sigma_per_h:
        said.append(
            f"The lamp's brightness changes by {percent(found.lamp_drift_per_h, signed=True)} an hour: let it warm "
            "up before captures."
        )
    if found.defects:
        said.append(f"{len(found.defects)} pixels are defective; response.json lists them.")
    return said


def draw(found: ResponseFit, path: Path) -> None:
    """Draws the photon-transfer curve with its line, and the lamp's brightness by exposure time."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load and seldom needed

    figure = Figure(figsize=(9, 4), layout="constrained")
    transfer, lamp = figure.subplots(1, 2)
    _, gain, read_noise, _, _ = found.values.tolist()
    level = np.geomspace(1, max(float(found.curve.level.max()), 2.0), 100)
    transfer.loglog(np.maximum(found.curve.level, 1), np.sqrt(found.curve.variance), ".", markersize=3)
    transfer.loglog(level, np.sqrt(level / gain + (read_noise / gain) ** 2 + 1 / 12), label=f"{gain:.3g} e⁻ per value")
    transfer.set(xlabel="value above black", ylabel="1 σ of a value")
    transfer.legend()
    times = [one.exposure_s for one in found.points for _ in one.lamp]
    lamp.semilogx(times, [100 * (value - 1) for one in found.points for value in one.lamp], ".")
    lamp.set(xlabel="exposure time, s", ylabel="lamp against its mean, %")
    figure.savefig(path, dpi=120)
