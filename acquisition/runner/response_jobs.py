"""Jobs of sessions that calibrate the camera's response: one light for all images, and the estimate from them.

They are pure except for the files of an estimate, which are written as a whole: an existing folder is complete.
"""

from functools import partial
from pathlib import Path

import numpy as np

from acquisition import geometry
from acquisition.calibrate import response, response_results
from acquisition.calibrate.response_frames import ResponseFrame
from acquisition.formats.atomic_write import atomic_folder, discard_partial
from acquisition.models.base import as_joints
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import ResponseRecipe
from acquisition.models.calibration_result import USE_IT, CalibrationSummary
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.shot import Observations
from acquisition.runner.estimate_files import CALIBRATION, SUMMARY, write_json
from acquisition.waypoints import routing
from acquisition.waypoints.reach import refusals
from acquisition.waypoints.roadmap import dome_center, dome_lights

AT_ONCE = 16
"""Number of dome positions that are tried together, the nearest to the view axis first."""


def response_light(recipe: ResponseRecipe, cell: CellConfig, calibration: Calibration) -> LightPlan:
    """Chooses one light for all images: the reachable one nearest to the view axis, which leaves the least in shadow.

    Raises RigError waypoints.unreachable if the lamp reaches none.
    """
    dome = dome_lights(cell, calibration, cell.dome.candidates)
    slants = geometry.slant_azimuth(np.array([one.position for one in dome]) - dome_center(cell, calibration))[0]
    light = None
    for some in np.array_split(np.argsort(slants), -(-len(dome) // AT_ONCE)):
        refused = refusals([dome[number] for number in some], cell, calibration)
        light = next((dome[number] for number, why in zip(some, refused, strict=True) if why is None), None)
        if light is not None:
            break
    if light is None:
        raise RigError(ErrorCode.WAYPOINTS_UNREACHABLE, "The lamp cannot reach any position on the dome", lights=[])
    joints = routing.route([light], cell.arm.home, cell, calibration).waypoints[0].joints
    settings = recipe.frames
    return LightPlan(
        lights=[light] * len(settings),
        method="response",
        reasons=[f"{one.share:.3f} of full scale, lamp {'on' if one.lit else 'off'}" for one in settings],
        joints=[as_joints(joints)] * len(settings),
    )


def estimate_response(
    recipe: ResponseRecipe, cell: CellConfig, calibration: Calibration, observations: Observations, folder: Path,
    last: bool,
) -> CalibrationSummary:  # fmt: skip
    """Estimates the camera's response from a session's images and writes the estimate's folder.

    Raises RigError calibration.infeasible.
    """
    shots = observations.shots
    frames = [
        ResponseFrame(
            shot.frame.path, shot.exposure_s, shot.lamp_on, shot.taken_at,
            partial(observations.frames.rows, shot.frame, 0, shot.frame.height),
        )
        for shot in shots
    ]  # fmt: skip
    found = response.estimate(frames, calibration.sensor.bits)
    result = response_results.result(found, {shot.frame.path: shot.frame.sha256 for shot in shots})
    changed = response_results.with_response(calibration, result)
    summary = CalibrationSummary(
        kind=recipe.kind,
        images=len(shots),
        used=len(shots),
        estimated=True,
        reached=last,
        gain_e_per_dn=result.gain_e_per_dn,
        read_noise_e=result.read_noise_e,
        full_well_e=result.full_well_e,
        defective_pixels=len(result.defects),
        fingerprint=changed.fingerprint,
        advice=response_results.advice(result) or [USE_IT],
    )
    discard_partial(folder)
    with atomic_folder(folder) as partial_folder:
        response_results.draw(found, partial_folder / "photon_transfer.png")
        write_json(partial_folder / "response.json", result)
        write_json(partial_folder / CALIBRATION, changed)
        write_json(partial_folder / SUMMARY, summary)
    return summary
