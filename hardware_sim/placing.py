"""Puts another object or calibration target into the running cell, as an operator does between two sessions."""

import json
import socket

from acquisition.models.errors import ErrorCode, RigError

ANSWER_WITHIN_S = 600.0
"""Time limit, s, for the answer. The world first builds the new scene and its truth, which takes seconds, and over two
minutes if twenty programs share two cores."""


def place(address: str, port: int, name: str) -> str:
    """Asks the simulated camera's world for a built-in object or target by name, and returns its label.

    The next frame shows it, and the controller's collision check includes it. Raises RigError device.disconnected if no
    simulated cell runs, and request.invalid with the world's reason if it cannot be placed.
    """
    try:
        with socket.create_connection((address, port), ANSWER_WITHIN_S) as connection:
            connection.sendall(json.dumps({"place": name}).encode() + b"\n")
            with connection.makefile("rb") as lines:
                answer = json.loads(lines.readline() or b"null")
    except (OSError, ValueError) as error:
        raise RigError(
            ErrorCode.DEVICE_DISCONNECTED, f"no simulated cell answers at {address}:{port}: {error}"
        ) from error
    if not isinstance(answer, dict) or "placed" not in answer:
        why = answer.get("error") if isinstance(answer, dict) else "the simulated cell closed the connection"
        raise RigError(ErrorCode.REQUEST_INVALID, str(why), object=name)
    return str(answer["placed"])
