"""Readiness of the devices: connection, and comparison of the arm with the cell file; nothing moves.

Missing devices are reconnected periodically while nothing runs, so that the service starts without a device and reports
which is missing. After a restart with an interrupted session the arm is only read: its stops are known, and nothing is
armed before a person resumes. `make_ready` is the explicit step before a session, which also compares the arm with the
cell file.
"""

import logging
from typing import Any

from acquisition.capture import camera_fit
from acquisition.devices import Arm, ArmIdentity, Rig
from acquisition.models.base import Vector3
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import problem
from acquisition.runner.rig_choices import RigChoices
from acquisition.waypoints import mounted_tool

_log = logging.getLogger(__name__)


class Readiness:
    """Connects the devices of a rig, in the runner's thread; any thread may read the attributes."""

    def __init__(self, rig: Rig, choices: RigChoices) -> None:
        """`choices` gives the tool on the flange and the calibration in use."""
        self._rig, self._choices = rig, choices
        self.identity: ArmIdentity | None = None
        self.camera_ready = False
        self.was_complete = False  # whether all devices have been connected since the service started
        self._only_read = False  # whether it was connected last without control
        self.payload_sent = True  # False if sending the payload of the tool stated last has failed
        self.problems: list[dict[str, Any]] = [
            problem(ErrorCode.RIG_NOT_READY, "The devices have not been connected yet")
        ]

    def make_ready(self) -> ArmIdentity:
        """Connects what is not connected, takes control of the arm, and compares it with the cell file.

        Raises RigError arm.unreachable, arm.in_use, arm.preflight (with `findings`), camera.unreachable, config.invalid
        for a camera that does not fit the calibration, and others.
        """
        try:
            self._rig.arm.set_payload(*self._payload())
            identity = self._rig.arm.connect()
            self._only_read = False
            # If connecting has not taken control, this raises why. If sending the payload failed, this sends it again.
            if not self._rig.arm.reading.program_running or not self.payload_sent:
                self._rig.arm.prepare()
            self.payload_sent = True
            require_preflight(self._rig.arm)
            self._rig.lamp.connect()
            self._connect_camera()
        except RigError as error:
            self.identity, self.camera_ready = None, False
            self.problems = [_as_problem(error)]
            raise
        self.identity, self.camera_ready, self.problems, self.was_complete = identity, True, [], True
        return identity

    @property
    def is_ready(self) -> bool:
        """Whether the arm may move as it is: nothing is missing, this program has control, the payload is right."""
        return not self.problems and self.payload_sent and self._rig.arm.reading.program_running

    def send_payload(self) -> None:
        """Sends the payload of another tool to the controller if this program has control; else `prepare` does so.

        Raises RigError as `Arm.prepare`; after that nothing moves before `make_ready` has sent the payload.
        """
        self.payload_sent = False
        self._rig.arm.set_payload(*self._payload())
        if self._rig.arm.reading.program_running:
            self._rig.arm.prepare()
        self.payload_sent = True

    def reconnect_missing(self, *, take_control: bool = True) -> bool:
        """Connects missing devices and keeps the problem of each; returns True if this has completed the rig.

        Without `take_control` the arm is only read, and a later call takes control.
        """
        if not self.problems and self._rig.arm.reading.connected and not (take_control and self._only_read):
            return False
        problems: list[dict[str, Any]] = []
        try:
            self._rig.arm.set_payload(*self._payload())
            self.identity = self._rig.arm.connect(take_control=take_control)
            self._only_read = not take_control
        except RigError as error:
            self.identity = None
            problems.append(_as_problem(error))
        try:
            if not self.camera_ready:
                self._connect_camera()
                self.camera_ready = True
        except RigError as error:
            problems.append(_as_problem(error))
        self.problems = problems
        self.was_complete = self.was_complete or not problems
        return not problems

    def _payload(self) -> tuple[float, Vector3]:
        """Mass, kg, and centre of gravity, m, of what is on the flange now."""
        return mounted_tool.payload(self._rig.cell, self._choices.tool)

    def _connect_camera(self) -> None:
        """Connects the camera. Raises RigError camera.unreachable, or config.invalid if it does not fit."""
        camera, calibration = self._rig.camera, self._choices.calibration
        camera.connect()
        if camera.capabilities is not None:
            for warning in camera_fit.require_fit(camera.capabilities, calibration, self._rig.cell.camera):
                _log.warning("%s", warning)


def require_preflight(arm: Arm) -> None:
    """Compares the arm with the cell file. Raises RigError arm.preflight with the `findings`, driver.lost."""
    findings = arm.preflight()
    if findings:
        raise RigError(
            ErrorCode.ARM_PREFLIGHT,
            " ".join(finding.what for finding in findings),
            findings=[{"what": finding.what, "remedy": finding.remedy} for finding in findings],
        )


def _as_problem(error: RigError) -> dict[str, Any]:
    return problem(error.code, error.detail, **error.context)
