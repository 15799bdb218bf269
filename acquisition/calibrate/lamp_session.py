"""Steps of a calibration session of the lamp: highlights of the sphere, patches of the plane, and the fits.

The sphere's images give the lamp's place in the tool's frame; the plane's images give intensity and lobe with that
place known. Of two or more placings of the plane the last takes no part and verifies the result. The tool's pose is the
one that the controller states, corrected by the joint offsets of the calibration in use (`waypoints.measured_pose`).
These are the offsets of the hand–eye calibration, so that camera, arm and lamp agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.calibrate import charuco, highlight, lamp_lobe, lamp_position, lamp_targets, matt_plane, plane_shading
from acquisition.calibrate.board_results import now
from acquisition.calibrate.charuco import View
from acquisition.calibrate.lamp_lobe import LobeFit
from acquisition.calibrate.lamp_position import Highlight, LampFit
from acquisition.calibrate.plane_shading import Known, Placing, PlaneImage
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import HandEyeResult
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import Observations, Shot
from acquisition.waypoints import measured_pose


@dataclass(frozen=True)
class SphereImages:
    """Highlights of the sphere's images, and the reason for each image without one, by name."""

    highlights: tuple[Highlight, ...]
    why_not: dict[str, str]


@dataclass(frozen=True)
class PlaneImages:
    """Patches of the plane's images; its placings, in the order of the passes."""

    images: tuple[PlaneImage, ...]
    placings: tuple[Placing, ...]


@dataclass(frozen=True)
class LobeFound:
    """The fit, the images that took part in it, and the mean error of normals on the verifying placing, degrees; None
    if there is only one placing."""

    fit: LobeFit
    fitted: tuple[PlaneImage, ...]
    verified_deg: float | None


def read_sphere(observations: Observations, cell: CellConfig, calibration: Calibration) -> SphereImages:
    """Finds the highlights in the sphere's images."""
    found: list[Highlight] = []
    why_not: dict[str, str] = {}
    for shot in _shots(observations, lamp_targets.SPHERE_PASS):
        tool = _tool(shot, cell, calibration)
        spot = highlight.find_of_lamp(_pixels(observations, shot), tool, shot.exposure_s, cell, calibration)
        if isinstance(spot, str):
            why_not[shot.frame.path] = spot
        else:
            moved = measured_pose.by_offsets(np.array(shot.joints), cell.arm, calibration)
            found.append(Highlight(shot.frame.path, spot, tool, moved))
    return SphereImages(tuple(found), why_not)


def place_lamp(
    images: SphereImages, cell: CellConfig, calibration: Calibration, hand_eye: HandEyeResult
) -> tuple[LampFit, Calibration]:
    """Estimates the lamp's place, and returns the calibration with it. Raises RigError calibration.infeasible."""
    targets = lamp_targets.require_targets(cell)
    found = lamp_position.fit(
        images.highlights, calibration, np.array(hand_eye.shared_covariance), targets.sphere_radius_m,
        lamp_targets.sphere_center(cell), targets.window_radius_m,
    )  # fmt: skip
    return found, found.calibrated(calibration, hand_eye).model_copy(update={"made_at": now()})


def read_plane(observations: Observations, cell: CellConfig, calibration: Calibration, passes: int) -> PlaneImages:
    """Finds the plane's pose in each placing (pass 1 to `passes` − 1), and the brightness of its patches.

    Raises RigError calibration.infeasible naming the placing whose frame is not seen, or moved.
    """
    images: list[PlaneImage] = []
    placings: list[Placing] = []
    for number in range(passes - 1):
        shown, placing = read_placing(observations, number + 1, number, cell, calibration)
        images += shown
        placings.append(placing)
    return PlaneImages(tuple(images), tuple(placings))


def read_placing(
    observations: Observations, pass_number: int, number: int, cell: CellConfig, calibration: Calibration
) -> tuple[list[PlaneImage], Placing]:
    """Measures the plane's patches in the images of a pass, and the plane's pose in this placing, the `number`-th.

    Raises RigError calibration.infeasible naming the placing whose frame is not seen, or moved.
    """
    board, images = lamp_targets.plane_board(cell), list[PlaneImage]()
    shots = _shots(observations, pass_number)
    views = [charuco.detect(_pixels(observations, shot), board, shot.frame.path) for shot in shots]
    seen: list[View] = [view for view in views if view is not None]
    if not seen:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"No image of placing {number} shows the plane's frame: check its description, focus and exposure",
        )
    placing = matt_plane.placing(seen, board, calibration)
    for shot in shots:
        dark = _dark(observations, shot)
        patches = matt_plane.patches(
            shot.frame.path, _pixels(observations, shot), _pixels(observations, dark), shot.exposure_s,
            (number, placing), _tool(shot, cell, calibration), board, calibration,
        )  # fmt: skip
        images.append(plane_shading.usable(patches, placing, calibration))
    return images, placing


def fit_lobe(
    plane: PlaneImages, cell: CellConfig, calibration: Calibration, lamp: LampFit, hand_eye: HandEyeResult
) -> tuple[LobeFound, Calibration]:
    """Estimates intensity and lobe, and returns the calibration with them; the last of several placings verifies them.

    `calibration` has the lamp's place. Raises RigError calibration.infeasible as `lamp_lobe.fit` does.
    """
    targets, board = lamp_targets.require_targets(cell), lamp_targets.plane_board(cell)
    known = Known(
        calibration, targets.albedo, targets.albedo_sigma, lamp.covariance, np.array(hand_eye.covariance), board.size_m
    )
    last = len(plane.placings) - 1
    fitted = [one for one in plane.images if len(one.values) and (last == 0 or one.placing < last)]
    found = lamp_lobe.fit(fitted, plane.placings[:last] if last else plane.placings, known)
    after = found.calibrated(calibration).model_copy(update={"made_at": now()})
    unused = [one for one in plane.images if last and one.placing == last]
    verified = _verified(unused, plane.placings[last], after, found) if unused else None
    return LobeFound(found, tuple(fitted), verified), after


def _verified(unused: Sequence[PlaneImage], placing: Placing, after: Calibration, found: LobeFit) -> float | None:
    """Mean error of normals, degrees, over a placing's images that show all patches; None with fewer than four."""
    most = max(len(one.values) for one in unused)
    whole = [one for one in unused if len(one.values) == most]
    return lamp_lobe.normal_error_deg(whole, placing, after, found.flat_field) if len(whole) >= 4 else None


def _shots(observations: Observations, pass_number: int) -> list[Shot]:
    return [shot for shot in observations.shots if shot.key.pass_number == pass_number]


def _dark(observations: Observations, shot: Shot) -> Shot:
    """Returns the lamp-off frame of an image's own placing: room light on the plane depends on where it lies.

    Raises RigError calibration.infeasible if there is none.
    """
    for dark in (*observations.darks.values(), *observations.repeats):
        same = dark.key.pass_number == shot.key.pass_number and dark.exposure_s == shot.exposure_s
        if dark.kind == "dark" and same:
            return dark
    raise RigError(
        ErrorCode.CALIBRATION_INFEASIBLE,
        f"{shot.frame.path}: this placing has no lamp-off image with an exposure of {1e3 * shot.exposure_s:g} ms",
    )


def _pixels(observations: Observations, shot: Shot) -> np.ndarray:
    return observations.frames.rows(shot.frame, 0, shot.frame.height)


def _tool(shot: Shot, cell: CellConfig, calibration: Calibration) -> FloatArray:
    return measured_pose.tool_pose(np.array(shot.base_from_tool), np.array(shot.joints), cell.arm, calibration)
