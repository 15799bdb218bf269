"""People's choices for the rig: the calibration that sessions are captured with, and the tool on the flange.

Both are events of the journal, so that they survive a restart and the history states who chose what. Neither changes
while a session holds the rig: its images are solved with the calibration that they were taken with, and its paths are
certified for the tool that is on the flange. Only a person can tell the service which tool that is; so a session that
needs another tool than the stated one is refused.
"""

import threading
from collections.abc import Callable
from pathlib import Path

from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import AnyRecipe, tool_of
from acquisition.models.calibration_set import CELL_FILE, CalibrationSet
from acquisition.models.camera_config import (
    AravisCameraConfig,
    FolderCameraConfig,
    GphotoCameraConfig,
    MicromanagerCameraConfig,
    PylonCameraConfig,
    SimCameraConfig,
)
from acquisition.models.cell_config import CellConfig, Tool
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.event_type import EventType
from acquisition.store import Store
from acquisition.waypoints import mounted_tool

CALIBRATION_CHOSEN: EventType = "calibration.activated"
TOOL_STATED: EventType = "tool.mounted"
"""Types of the events that hold the choices."""


def camera_name(cell: CellConfig) -> str:
    """Returns the cell's camera for people: its kind, and what identifies it (such as serial number or model)."""
    camera = cell.camera
    match camera:
        case SimCameraConfig():
            return f"sim {camera.port}"
        case PylonCameraConfig():
            return f"pylon {camera.serial}"
        case AravisCameraConfig():
            return f"aravis {camera.device}"
        case GphotoCameraConfig():
            return f"gphoto {camera.model}".strip()
        case MicromanagerCameraConfig():
            return f"micromanager {camera.adapter} {camera.device}"
        case FolderCameraConfig():
            return f"folder {camera.folder}"


class RigChoices:
    """The choices of one rig; any thread may call."""

    def __init__(
        self, store: Store, cell: CellConfig, of_cell: Calibration, refuse_used: Callable[[], None],
        arm_name: Callable[[], str | None],
    ) -> None:  # fmt: skip
        """`of_cell` is the calibration that the cell file names; `refuse_used` raises RigError rig.busy while the rig
        is in use; `arm_name` returns model and serial number of the connected arm, or None.

        Raises RigError store.corrupt when the chosen calibration is missing or damaged.
        """
        self._store, self._cell, self._of_cell = store, cell, of_cell
        self._refuse_used, self._arm_name = refuse_used, arm_name
        chosen = store.journal.newest(CALIBRATION_CHOSEN)
        self._id = CELL_FILE if chosen is None else str(chosen["id"])
        try:
            self._calibration = self.values(self._id)
        except RigError as error:
            if error.code is not ErrorCode.CALIBRATION_NOT_FOUND:
                raise
            missing = f"{store.data}/calibrations/{self._id}, the calibration in use, is missing"
            raise RigError(ErrorCode.STORE_CORRUPT, missing, file=self._id) from error
        stated = store.journal.newest(TOOL_STATED)
        self._tool: Tool = cell.arm.tool if stated is None else stated["tool"]
        self.changing = threading.Lock()  # also held while a session takes the rig; a halt never takes it

    @property
    def calibration(self) -> Calibration:
        """The calibration in use."""
        return self._calibration

    @property
    def calibration_id(self) -> str:
        """Identifier of the calibration in use; `cell` for that of the cell file."""
        return self._id

    @property
    def calibration_folder(self) -> Path | None:
        """Folder of the calibration set in use, with the covariances of its values; None for the cell file's values."""
        return None if self._id == CELL_FILE else self._store.calibrations.folder(self._id)

    @property
    def tool(self) -> Tool:
        """Tool on the flange, as a person stated it last."""
        return self._tool

    @property
    def cell(self) -> CellConfig:
        """The cell with the stated tool, for paths that belong to no session."""
        return mounted_tool.with_tool(self._cell, self._tool)

    @property
    def lamp_cell(self) -> CellConfig:
        """The cell with the lamp on the flange, whatever is there now, for the reach and all plans of lights."""
        return mounted_tool.with_tool(self._cell, "lamp")

    def values(self, identity: str) -> Calibration:
        """Returns the values of a calibration. Raises RigError calibration.not_found, store.corrupt."""
        return self._of_cell if identity == CELL_FILE else self._store.calibrations.calibration(identity)

    def choose_calibration(self, identity: str, actor: str) -> None:
        """Makes a calibration the one in use.

        Raises RigError calibration.not_found, calibration.does_not_fit, rig.busy, store.disk_full.
        """
        with self.changing:
            self._refuse_used()
            values = self.values(identity)
            if identity != CELL_FILE:
                self._require_fits(identity)
            body = {"id": identity, "fingerprint": values.fingerprint, "by": actor}
            self._store.journal.record_action(None, "activate-calibration", actor, identity)
            self._store.journal.announce(None, CALIBRATION_CHOSEN, body)
            self._id, self._calibration = identity, values

    def state_tool(self, tool: Tool, actor: str) -> None:
        """Records the tool that a person states. Raises RigError rig.busy; config.invalid for a board without one."""
        with self.changing:
            self._refuse_used()
            mounted_tool.with_tool(self._cell, tool)
            self._store.journal.record_action(None, "mount-tool", actor, tool)
            self._store.journal.announce(None, TOOL_STATED, {"tool": tool, "by": actor})
            self._tool = tool

    def require_tool(self, recipe: AnyRecipe) -> None:
        """Raises RigError rig.other_tool unless the tool that a session needs is the stated one."""
        needed = tool_of(recipe)
        if needed != self._tool:
            raise RigError(
                ErrorCode.RIG_OTHER_TOOL,
                f"A session of kind {recipe.kind} needs the {needed} on the flange, but the {self._tool} is stated: "
                f"mount the {needed}, then state it",
                needed=needed,
                stated=self._tool,
            )

    def differences(self, made: CalibrationSet) -> list[str]:
        """Lists for people in what a calibration does not fit this rig; empty if it fits."""
        arm = self._arm_name()
        size = (self._of_cell.width, self._of_cell.height)
        found = [
            f"its images have {made.width} × {made.height} pixels, but this camera has {size[0]} × {size[1]}"
            if (made.width, made.height) != size
            else "",
            f"it was made with camera {made.camera}, but this is {camera_name(self._cell)}"
            if made.camera != camera_name(self._cell)
            else "",
            f"it was made with arm {made.arm}, but this is {arm}" if arm is not None and made.arm != arm else "",
        ]
        return [one for one in found if one]

    def _require_fits(self, identity: str) -> None:
        differences = self.differences(self._store.calibrations.get(identity))
        if differences:
            raise RigError(
                ErrorCode.CALIBRATION_DOES_NOT_FIT, f"Calibration {identity}: {'; '.join(differences)}", id=identity
            )
