"""The options of `lightpose plan`, and the capture for which it plans, in the folder's own frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from acquisition import geometry
from acquisition.formats import folders
from acquisition.formats.folders import near_light_folder, session_folder
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.normals import distant, equivalent_session, near_light
from acquisition.normals.equivalent_session import EquivalentSession
from acquisition.normals.images.image_set import DistantLights, ImageSet, NearLights, check
from acquisition.runner.session_solve import solve_in_cell
from api.cli.solving import session_full_scale


@dataclass(frozen=True)
class PlanRequest:
    """Options of one plan; None where not given."""

    folder: Path
    count: int
    candidates: Path | None = None
    radius_mm: float | None = None
    max_slant_deg: float | None = None
    pilot: tuple[int, ...] | None = None
    out: Path | None = None
    full_scale: float | None = None


@dataclass(frozen=True)
class Frame:
    """A folder's own frame: the word for its lights, its axes and unit in words, and the conversion of its numbers.

    `view_from_own` (3, 3) transforms its numbers to the view frame: positions to m, directions to any length.
    """

    word: str  # position or direction
    axes: str
    unit: str | None
    view_from_own: FloatArray

    def view(self, own: FloatArray) -> FloatArray:
        """Converts numbers (K, 3) of the folder to positions in m, or to directions, in the view frame."""
        return own @ self.view_from_own.T

    def own(self, view: FloatArray) -> FloatArray:
        """The inverse of `view`."""
        return view @ np.linalg.inv(self.view_from_own).T


VIEW_AXES, CAMERA_AXES = "x right, y up, z to the camera", "x right, y down, z away from the camera (OpenCV)"


@dataclass(frozen=True)
class Capture:
    """A folder's images: its frame, its lights (F, 3) in that frame, their names, and its recipe."""

    frame: Frame
    lights: FloatArray
    names: tuple[str, ...]
    images: ImageSet | session_folder.SessionCapture
    recipe: Recipe

    def solved(self, pilot: Sequence[int]) -> EquivalentSession:
        """Solves the images `pilot` as `lightpose solve` does."""
        if isinstance(self.images, session_folder.SessionCapture):
            captured = self.images.observations(len(self.images.plans) - 1)
            lit = [shot for shot in captured.shots if shot.light is not None]
            observations = replace(captured, shots=[lit[number] for number in pilot])
            calibration = self.images.calibration
            normal_map = solve_in_cell(observations, self.images.cell, calibration, SolveSettings())
            return EquivalentSession(normal_map, observations, calibration)
        images = self.images.only(pilot)
        check(images)
        near = images if isinstance(images.lights, NearLights) else distant.from_afar(images)
        return equivalent_session.of_near(near, near_light.solve(near, SolveSettings()))


def read(request: PlanRequest, scratch: Path) -> Capture:
    """Reads the capture of a folder, unpacked into `scratch`. Raises RigError folder.invalid and normals.infeasible."""
    folder = request.folder
    kind = folders.kind_of(folder)
    if kind == "session":
        if request.full_scale is not None:
            raise session_full_scale(folder)
        session = session_folder.read(folder)
        shots = [shot for shot in session.observations(len(session.plans) - 1).shots if shot.light is not None]
        lights = np.array([shot.light.position for shot in shots if shot.light is not None]).reshape(-1, 3)
        frame = Frame("position", VIEW_AXES, "m", np.eye(3))
        return Capture(frame, lights, tuple(shot.frame.path for shot in shots), session, session.recipe)
    images = folders.read(folder, scratch, full_scale=request.full_scale)
    if isinstance(images.lights, DistantLights):
        frame = Frame("direction", VIEW_AXES, None, np.eye(3))
        return Capture(frame, images.lights.directions, images.names, images, Recipe())
    unit = near_light_folder.unit(folder)
    to_view = geometry.VIEW_FROM_CAMERA[:3, :3] * near_light_folder.METRES[unit]
    frame = Frame("position", CAMERA_AXES, unit, to_view)
    return Capture(frame, frame.own(images.lights.positions_m), images.names, images, Recipe())


def invalid(detail: str, path: Path | None = None) -> RigError:
    """Returns the refusal of an option."""
    return RigError(ErrorCode.REQUEST_INVALID, detail, **({} if path is None else {"file": str(path)}))
