"""PolyScope X: queries and recovery by the Robot API (REST over HTTP), the second halt path by the primary interface.

There is no dashboard. Each request to the Robot API opens a new connection; requests are as rare as a person's actions.
Halting does not go through it, because web services stand between it and the controller proper, which the primary
interface reaches directly. Sources: UR's C++ client library (`dashboard_client_implementation_x.cpp`,
`primary_client.cpp`) and the manual's page on remote mode. Nothing here has been tried on a real controller.
"""

import http.client
import json
from http import HTTPStatus
from typing import Any, cast
from urllib.parse import urlsplit

from acquisition.devices import UNKNOWN, ArmIdentity, RecoveryStep
from acquisition.devices.ur import primary, tcp
from acquisition.devices.ur.primary import PrimaryStop
from acquisition.devices.ur.software import ControllerState, Version
from acquisition.models.errors import ErrorCode, RigError

BASE = "/universal-robots/robot-api"

OLDEST = (10, 12)
"""First PolyScope X whose Robot API reports whether the arm is in remote control (3.1.4)."""

IDENTITY_SINCE = (10, 14)
"""First PolyScope X whose Robot API reports model and serial number (5.0.107)."""

ANSWER_S = 5.0
"""Time-out, s, of a query."""

RECOVERY_S = 60.0
"""Time-out, s, of a recovery step: the controller may answer after it is done, and powering on takes many seconds."""

_MOST_REDIRECTIONS = 3
_LONGEST_ANSWER = 1 << 16

_RECOVERY: dict[RecoveryStep, str] = {
    "unlock": "UNLOCK_PROTECTIVE_STOP",
    "power": "POWER_ON",
    "brakes": "BRAKE_RELEASE",
}


class PolyScopeX:
    """A controller with a Robot API; see the Protocol `Software`."""

    stop_path = "the primary interface"

    def __init__(self, address: str, api_port: int, stop_deceleration_rad_s2: float) -> None:
        self._address = address
        self._api_port = api_port
        self._stop_deceleration_rad_s2 = stop_deceleration_rad_s2
        self._version: Version | None = None

    def probe(self, version: Version) -> None:
        """Raises RigError arm.unreachable unless both interfaces answer, config.invalid for a version before 10.12."""
        if version < OLDEST:
            raise RigError(
                ErrorCode.CONFIG_INVALID,
                f"The controller at {self._address} runs PolyScope X {version}, whose Robot API does not report "
                f"whether the arm is in remote control: update it to {OLDEST[0]}.{OLDEST[1]} or later.",
                address=self._address,
            )
        self._version = version
        port = primary.PORT
        try:
            tcp.connect(self._address, port, tcp.PROBE_S).close()
            port = self._api_port
            self._exchange("GET", "/system/v1/controlmode", None, tcp.PROBE_S)
        except OSError as error:
            raise tcp.unreachable(self._address, port, error) from error

    def state(self) -> ControllerState:
        """Asks the Robot API. Raises RigError arm.unreachable."""
        status, mode = self._ask("GET", "/system/v1/controlmode", None, ANSWER_S)
        if status != HTTPStatus.OK:
            raise self._failed(f"answers the request for the control mode with status {status}")
        status, arm = self._ask("GET", "/system/v1/information", None, ANSWER_S)
        if status != HTTPStatus.OK:  # before 10.14
            arm = {}
        identity = ArmIdentity(
            str(arm.get("robotType") or UNKNOWN),
            str(arm.get("serialNumber") or UNKNOWN),
            f"PolyScope X {self._version or UNKNOWN}",
        )
        return ControllerState(identity, mode.get("mode") == "REMOTE")

    def recover(self, step: RecoveryStep) -> None:
        """Carries out one step by the Robot API. Raises RigError safety.recovery_refused, arm.unreachable."""
        status, answer = self._ask("PUT", "/robotstate/v1/state", {"action": _RECOVERY[step]}, RECOVERY_S)
        if not HTTPStatus.OK <= status < HTTPStatus.MULTIPLE_CHOICES:
            reply = (
                " ".join(str(answer[name]) for name in ("message", "details") if answer.get(name)) or "no reason given"
            )
            detail = f"The controller answers with status {status}: {reply.removesuffix('.')}."
            if status == HTTPStatus.FORBIDDEN:
                detail += " Select Automatic, then Remote, in the pendant's safety overview."
            raise RigError(ErrorCode.SAFETY_RECOVERY_REFUSED, detail, step=step, reply=reply)

    def open_stop(self, timeout_s: float) -> PrimaryStop:
        """Opens a connection to the primary interface. Raises OSError."""
        return PrimaryStop(self._address, timeout_s, self._stop_deceleration_rad_s2)

    def limits(self) -> tuple[str, ...]:
        """Lists what no interface of PolyScope X allows from here."""
        limits = [
            "remote control can be switched on only at the pendant: safety overview, Automatic, Remote",
            "in local control the primary interface is read-only, so there is no second halt path: stop at the pendant",
        ]
        if self._version is not None and self._version < IDENTITY_SINCE:
            limits.append(
                "model and serial number cannot be read before PolyScope X 10.14: only the kinematics show whether it "
                "is the right arm"
            )
        return tuple(limits)

    def _ask(self, method: str, path: str, content: object, timeout_s: float) -> tuple[int, dict[str, Any]]:
        try:
            return self._exchange(method, path, content, timeout_s)
        except OSError as error:
            raise self._failed(f"does not answer: {error or 'time-out'}") from error

    def _failed(self, what: str) -> RigError:
        detail = f"The Robot API of {self._address}, port {self._api_port}, {what}."
        return RigError(ErrorCode.ARM_UNREACHABLE, detail, address=self._address, port=self._api_port)

    def _exchange(self, method: str, path: str, content: object, timeout_s: float) -> tuple[int, dict[str, Any]]:
        """Returns the answer to one request; follows redirections on the same port. Raises OSError."""
        tcp.refuse_foreign(self._address)
        body = None if content is None else json.dumps(content)
        headers = {"Accept": "application/json"} | ({} if body is None else {"Content-Type": "application/json"})
        target = BASE + path
        for _ in range(1 + _MOST_REDIRECTIONS):
            connection = http.client.HTTPConnection(self._address, self._api_port, timeout=timeout_s)
            try:
                connection.request(method, target, body, headers)
                response = connection.getresponse()
                location = response.getheader("Location")
                if not (HTTPStatus.MULTIPLE_CHOICES <= response.status < HTTPStatus.BAD_REQUEST and location):
                    return response.status, _content(response.read(_LONGEST_ANSWER))
            except http.client.HTTPException as error:
                raise ConnectionError(f"does not speak HTTP: {error!r}") from error
            finally:
                connection.close()
            moved = urlsplit(location)
            if moved.scheme == "https" or moved.hostname not in (None, self._address):
                raise ConnectionError(f"redirects to {location}, which is not this port's Robot API")
            target = moved.path
        raise ConnectionError(f"redirects more than {_MOST_REDIRECTIONS} times")


def _content(body: bytes) -> dict[str, Any]:
    """Returns the JSON object of an answer; empty if it has none."""
    try:
        content = json.loads(body)
    except ValueError:
        return {}
    return cast(dict[str, Any], content) if isinstance(content, dict) else {}
