"""Jobs of sessions that calibrate the lamp: poses of a pass, judgement of a frame, estimate.

Poses are configurations of the arm rather than lights: a light may be turned freely about the lamp's axis, but the
lamp's position in the tool frame shows only if the tool turns. Among the poses that are connected to home, those for
the sphere are chosen by optimum design, like lights and views. Those for the plane are spread over the angles off the
lamp's axis.
"""

from pathlib import Path

import numpy as np

from acquisition import geometry, lamp_pose, photometry
from acquisition.calibrate import (
    charuco,
    highlight,
    lamp_position,
    lamp_results,
    lamp_session,
    lamp_targets,
    stated_values,
)  # fmt: skip
from acquisition.capture.compare import MAX_SHIFT_PX, has_shifted
from acquisition.capture.take import Exposed
from acquisition.formats.atomic_write import atomic_folder, discard_partial
from acquisition.models.base import FloatArray, as_joints
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.calibration_recipe import LampRecipe
from acquisition.models.calibration_result import USE_IT, CalibrationSummary
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.shot import Observations
from acquisition.runner.estimate_files import CALIBRATION, SUMMARY, write_json
from acquisition.waypoints import measured_pose
from acquisition.waypoints.roadmap import connected_lights, dome_center

CANDIDATES_PER_POSE = 4
"""Number of candidates tried for each wanted pose; the arm reaches about half of them."""

SPHERE_TILT_DEG, PLANE_TILT_DEG = 45.0, 42.0
"""Largest tilt of the lamp away from the target, degrees. For the sphere, tilt makes the lamp's position along its axis
observable; for the plane, it makes the lobe observable to 40° and more."""

SPHERE_SLANT_DEG, PLANE_SLANT_DEG = 70.0, 55.0
"""Largest slant of the lamp's positions, degrees; a plane that is lit from the side reflects little light."""

NEAREST, FARTHEST = 0.85, 1.1
"""Range of the lamp's distances from the dome's centre, in units of the dome's radius. Different distances separate the
lamp's position from the sphere's."""


def lamp_poses(
    recipe: LampRecipe, cell: CellConfig, calibration: Calibration, number: int, set_folder: Path | None
) -> LightPlan:
    """Plans the poses of a pass. `set_folder` is that of the calibration set in use (None: the cell file's values).

    Raises RigError calibration.infeasible without a hand–eye calibration or with too few poses, config.invalid without
    targets.
    """
    targets, hand_eye = lamp_targets.require_targets(cell), stated_values.hand_eye(set_folder)
    seed = recipe.seed + 7 * number
    if number != lamp_targets.SPHERE_PASS:
        return plane_poses(recipe.placing_images, seed, cell, calibration)
    joints = _reached(recipe.first_images, seed, cell, calibration, sphere=True)
    chosen = lamp_position.choose_poses(
        measured_pose.tools(joints, cell.arm, calibration), calibration, np.array(hand_eye.covariance),
        lamp_targets.sphere_center(cell), targets.sphere_radius_m, recipe.first_images,
    )  # fmt: skip
    return _plan(joints, chosen, recipe.first_images, cell, calibration, sphere=True)


def plane_poses(count: int, seed: int, cell: CellConfig, calibration: Calibration) -> LightPlan:
    """Plans `count` random poses of the lamp over the matt plane. Raises RigError calibration.infeasible."""
    lamp_targets.require_targets(cell)
    joints = _reached(count, seed, cell, calibration, sphere=False)
    return _plan(joints, list(range(min(count, len(joints)))), count, cell, calibration, sphere=False)


def _reached(count: int, seed: int, cell: CellConfig, calibration: Calibration, *, sphere: bool) -> FloatArray:
    """Returns the joints (N, 6) of those candidates for `count` poses that are connected to home."""
    lights = _candidates(cell, calibration, CANDIDATES_PER_POSE * count, seed, sphere=sphere)
    return connected_lights(lights, cell, calibration)


def _plan(
    joints: FloatArray, chosen: list[int], count: int, cell: CellConfig, calibration: Calibration, *, sphere: bool
) -> LightPlan:
    """Makes the plan of the chosen poses. Raises RigError calibration.infeasible if they are fewer than `count`."""
    if len(chosen) < count:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"The arm reaches only {len(chosen)} of the {count} requested poses of the lamp over the object's place: "
            "request fewer images, or extend the reach",
        )
    tools = measured_pose.tools(joints, cell.arm, calibration)
    shown = [lamp_pose.light_from_tool(tools[one], calibration) for one in chosen]
    return LightPlan(
        lights=shown,
        method="sphere" if sphere else "plane",
        reasons=[f"lamp tilted by {_tilt_deg(light, cell, calibration):.0f}°" for light in shown],
        joints=[as_joints(joints[one]) for one in chosen],
        levels_per_s=None if sphere else _plane_levels(shown, cell, calibration),
    )


def look_at_target(
    exposed: Exposed, exposure_s: float, sphere: bool, cell: CellConfig, calibration: Calibration,
    placed_before: np.ndarray | None,
) -> str:  # fmt: skip
    """Returns for people why a frame cannot be used; empty if the target is seen.

    `placed_before` is a frame (H, W) of the plane's previous placing, from which this one has to differ.
    """
    pixels, reading = exposed.frame.pixels, exposed.reading
    if sphere:
        tool = measured_pose.tool_pose(reading.base_from_tool, np.array(reading.joints), cell.arm, calibration)
        spot = highlight.find_of_lamp(pixels, tool, exposure_s, cell, calibration)
        return spot if isinstance(spot, str) else ""
    board = lamp_targets.plane_board(cell)
    seen = charuco.detect(pixels, board, "frame")
    if seen is None:
        return (
            f"the matt plane's frame ({board.columns} × {board.rows} squares of {1e3 * board.square_m:g} mm) is not "
            "seen: check that the plane of the cell file lies in the object's place, face up, and that the lamp is on"
        )
    before = None if placed_before is None else charuco.detect(placed_before, board, "before")
    if before is not None and charuco.shift_px(before, seen) < MAX_SHIFT_PX:
        return "the plane lies as in the previous placing: lay it on a wedge, tilted by 10–20°"
    return ""


def target_moved(before: np.ndarray, after: np.ndarray, sphere: bool, cell: CellConfig, sensor: SensorModel) -> str:
    """Returns for people how the target has moved between two frames (H, W) of one pose; empty if it has not."""
    if sphere:
        first, second = (highlight.find(one, float(2**sensor.bits - 1)) for one in (before, after))
        if isinstance(second, str):
            # The first image had the same exposure time and was not clipped.
            return (
                f"{second}; it was not clipped before: the lamp or the camera has changed"
                if second == lamp_targets.CLIPPED_HIGHLIGHT
                else second
            )
        shift_px = 0.0 if isinstance(first, str) else float(np.linalg.norm(second.pixel - first.pixel))
    else:
        board = lamp_targets.plane_board(cell)
        one, other = charuco.detect(before, board, "before"), charuco.detect(after, board, "after")
        if other is None:
            return "the plane's frame is not seen any more"
        shift_px = 0.0 if one is None else charuco.shift_px(one, other)
    if has_shifted(shift_px, before.shape[1]):
        what = "the highlight" if sphere else "the plane's frame"
        return f"{what} has shifted by {shift_px:.1f} pixels: the target, the camera or the lamp has moved"
    return ""


def estimate_lamp(
    recipe: LampRecipe, cell: CellConfig, calibration: Calibration, observations: Observations, set_folder: Path | None,
    folder: Path,
) -> CalibrationSummary:  # fmt: skip
    """Calibrates from all images of a session and writes the estimate's folder.

    The sphere gives the lamp's position; the plane, if it has been captured, gives intensity and lobe. Raises RigError
    calibration.infeasible.
    """
    hand_eye = stated_values.hand_eye(set_folder)
    hashes = {shot.frame.path: shot.frame.sha256 for shot in observations.shots}
    passes = 1 + max(shot.key.pass_number for shot in observations.shots)
    images = lamp_session.read_sphere(observations, cell, calibration)
    lamp, made = lamp_session.place_lamp(images, cell, calibration, hand_eye)
    summary = CalibrationSummary(
        kind=recipe.kind, images=len(hashes), used=len(images.highlights), estimated=True,
        position_sigma_mm=1e3 * lamp.sigma_m,
    )  # fmt: skip
    of_sphere = {name: digest for name, digest in hashes.items() if _pass_of(name) == lamp_targets.SPHERE_PASS}
    discard_partial(folder)
    with atomic_folder(folder) as partial:
        result = lamp_results.lamp_result(lamp, images.highlights, images.why_not, of_sphere)
        write_json(partial / "lamp.json", result)
        if passes > 1:
            plane = lamp_session.read_plane(observations, cell, made, passes)
            lobe, made = lamp_session.fit_lobe(plane, cell, made, lamp, hand_eye)
            full_scale_dn = calibration.sensor.full_scale_dn
            found = lamp_results.lobe_result(
                lobe.fit, plane.images, lobe.fitted, hashes, lobe.verified_deg, full_scale_dn
            )
            write_json(partial / "lobe.json", found)
            lamp_results.draw_lobe(lobe.fit, calibration, partial / "lobe.png")
            sigma = np.sqrt(np.diag(lobe.fit.covariance))
            summary = summary.model_copy(
                update={
                    "used": len(images.highlights) + sum(len(one.values) > 0 for one in plane.images),
                    "intensity_sigma_percent": 100 * float(sigma[0]),
                    "lobe_sigma_percent": 100 * float(sigma[1:-2].max()),
                    "verified_deg": lobe.verified_deg,
                }
            )
        summary = summary.model_copy(
            update={
                "fingerprint": made.fingerprint, "reached": passes == recipe.passes_most, "advice": _advice(summary),
            }
        )  # fmt: skip
        write_json(partial / CALIBRATION, made)
        write_json(partial / SUMMARY, summary)
    return summary


def _advice(found: CalibrationSummary) -> list[str]:
    said: list[str] = []
    if found.position_sigma_mm is not None and found.position_sigma_mm > 0.5:
        said.append("The uncertainty of the lamp's position exceeds 0.5 mm: take more images of the sphere.")
    if found.verified_deg is not None and found.verified_deg > 0.5:
        said.append(
            "On the verification placing, normals are off by more than 0.5°: check that the plane is flat and matt, "
            "and lit by the lamp alone."
        )
    return said or [USE_IT]


def _candidates(cell: CellConfig, calibration: Calibration, count: int, seed: int, *, sphere: bool) -> list[Light]:
    """Draws random lights (view frame) over the object's place, tilted away from it to random sides."""
    random = np.random.default_rng([19, seed])
    center, up = dome_center(cell, calibration), _up(cell, calibration)
    tilt_deg, slant_deg = (SPHERE_TILT_DEG, SPHERE_SLANT_DEG) if sphere else (PLANE_TILT_DEG, PLANE_SLANT_DEG)
    steepest = np.cos(np.radians(min(slant_deg, cell.dome.max_slant_deg)))
    made: list[Light] = []
    while len(made) < count:
        cosine = random.uniform(steepest, np.cos(np.radians(cell.dome.min_slant_deg)))
        towards = up @ np.asarray(geometry.direction(np.arccos(cosine), random.uniform(0, 2 * np.pi)))
        tilt = np.radians(random.uniform(0, tilt_deg))
        side = np.cross(towards, random.standard_normal(3))
        axis = -np.cos(tilt) * towards + np.sin(tilt) * side / np.linalg.norm(side)
        place = center + random.uniform(NEAREST, FARTHEST) * cell.dome.radius_m * towards
        x, y, z = (float(value) for value in place)
        u, v, w = (float(value) for value in axis)
        made.append(Light(position=(x, y, z), axis=(u, v, w)))
    return made


def _up(cell: CellConfig, calibration: Calibration) -> FloatArray:
    """Returns the rotation (3, 3) from the object's frame, z up, to the view frame."""
    base_from_object = cell.object.keep_out.base_from_object.matrix[:3, :3]
    return lamp_pose.base_from_view(calibration)[:3, :3].T @ base_from_object


def _tilt_deg(light: Light, cell: CellConfig, calibration: Calibration) -> float:
    towards = dome_center(cell, calibration) - np.array(light.position)
    cosine = float(np.array(light.axis) @ towards / np.linalg.norm(towards))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _plane_levels(lights: list[Light], cell: CellConfig, calibration: Calibration) -> list[float]:
    """Returns the signal at the centre of a flat plane under each light, fraction of full scale per second."""
    center, normal = dome_center(cell, calibration), _up(cell, calibration)[:, 2]
    points = center[:, None].astype(np.float32)
    vectors = photometry.light_vectors(points, photometry.lamps(lights), calibration)[:, :, 0]
    shading = np.maximum(vectors.astype(float) @ normal, 1e-3)
    return (lamp_targets.require_targets(cell).albedo * calibration.lamp_intensity * shading).tolist()


def _pass_of(frame: str) -> int:
    """Returns an image's pass from the name of its file, `passes/<number>/shots/…`."""
    return int(Path(frame).parts[1])
