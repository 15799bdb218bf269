"""Messages of the controller to its clients: texts, popups, labels and errors of programs, and safety modes.

The controller and its functions put them into `Controller.announcements`. Between ticks the ports take them out and
send them in their own formats: the primary interface by type, RTDE as texts.
"""

from dataclasses import dataclass
from enum import IntEnum


class MessageType(IntEnum):
    """Types of robot messages, with their numbers in the primary interface (UR client interface)."""

    TEXT = 0
    PROGRAM_LABEL = 1
    POPUP = 2
    SAFETY_MODE = 5
    KEY = 7
    RUNTIME_EXCEPTION = 10


@dataclass(frozen=True)
class RobotMessage:
    """One message; `title`, `warning`, `error` and `blocking` belong to popups and keys, `number` to labels and safety
    modes."""

    type: MessageType
    text: str
    title: str = ""
    number: int = 0
    warning: bool = False
    error: bool = False
    blocking: bool = False
