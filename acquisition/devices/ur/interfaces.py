"""The part of ur-rtde 1.6.5 that the driver uses, with the types that the library itself does not state.

It is short on purpose. These functions exist but are not used: synchronous moves (they block for minutes and cannot be
stopped), paths in one command (they stop the program and upload it again), asynchronous stops (they change the kind of
every later stop), `getForwardKinematics(q)` (the library does not send the tool offset) and the "realtime" getters
(they return whatever the registers held before).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


class OperationStatus(Protocol):
    """The asynchronous status word."""

    def operationId(self) -> int: ...  # noqa: N802

    def isAsyncOperationRunning(self) -> bool: ...  # noqa: N802


class Control(Protocol):
    """rtde_control.RTDEControlInterface."""

    def isConnected(self) -> bool: ...  # noqa: N802

    def isProgramRunning(self) -> bool: ...  # noqa: N802

    def reuploadScript(self) -> bool: ...  # noqa: N802

    def setTcp(self, tcp_offset: list[float], /) -> bool: ...  # noqa: N802

    def setPayload(self, mass: float, cog: list[float], /) -> bool: ...  # noqa: N802

    def setWatchdog(self, min_frequency: float) -> bool: ...  # noqa: N802

    def kickWatchdog(self) -> bool: ...  # noqa: N802

    def moveJ(self, q: list[float], speed: float, acceleration: float, asynchronous: bool) -> bool: ...  # noqa: N802

    def isJointsWithinSafetyLimits(self, q: list[float], /) -> bool: ...  # noqa: N802

    def stopJ(self, a: float) -> None: ...  # noqa: N802

    def getAsyncOperationProgressEx(self) -> OperationStatus: ...  # noqa: N802

    def getTCPOffset(self) -> list[float]: ...  # noqa: N802

    def getForwardKinematics(self) -> list[float]: ...  # noqa: N802


class Receive(Protocol):
    """rtde_receive.RTDEReceiveInterface."""

    def isConnected(self) -> bool: ...  # noqa: N802

    def getTimestamp(self) -> float: ...  # noqa: N802

    def getActualQ(self) -> list[float]: ...  # noqa: N802

    def getActualQd(self) -> list[float]: ...  # noqa: N802

    def getActualTCPPose(self) -> list[float]: ...  # noqa: N802

    def getTargetSpeedFraction(self) -> float: ...  # noqa: N802

    def getRobotMode(self) -> int: ...  # noqa: N802

    def getSafetyStatusBits(self) -> int: ...  # noqa: N802

    def getRuntimeState(self) -> int: ...  # noqa: N802

    def getActualDigitalOutputBits(self) -> int: ...  # noqa: N802

    def getPayload(self) -> float: ...  # noqa: N802

    def getPayloadCog(self) -> list[float]: ...  # noqa: N802


class Outputs(Protocol):
    """rtde_io.RTDEIOInterface."""

    def setStandardDigitalOut(self, output_id: int, signal_level: bool) -> bool: ...  # noqa: N802

    def setConfigurableDigitalOut(self, output_id: int, signal_level: bool) -> bool: ...  # noqa: N802

    def setToolDigitalOut(self, output_id: int, signal_level: bool) -> bool: ...  # noqa: N802


@dataclass(frozen=True)
class Constructors:
    """Constructors of each interface for an address; they hold the interpreter lock and raise RuntimeError."""

    control: Callable[[str], Control]
    receive: Callable[[str], Receive]
    outputs: Callable[[str], Outputs]
