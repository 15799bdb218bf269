"""The controller as a child process that ends with its parent."""

import select
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from acquisition.models.errors import ErrorCode, RigError
from hardware_sim.controller.calibration import TYPICAL_ERROR_M
from hardware_sim.controller.control import ControlClient

_START_TIMEOUT = 10.0  # s, on a loaded machine; it takes well under one


class ControllerProcess:
    """Starts a controller and ends it; a context manager.

    The child reads a pipe that only this process holds open: it ends when the parent does, however that dies.
    """

    def __init__(
        self,
        address: str,
        *,
        home: Sequence[float],
        model: str = "ur5e",
        calibration_seed: int | None = None,
        calibration_error_m: float = TYPICAL_ERROR_M,
        speed: float = 1.0,
        low_when_stopped: Iterable[int] = (0,),
        surroundings: Path | None = None,
        programs: Path | None = None,
        record: Path | None = None,
        log_level: str = "WARNING",
    ) -> None:
        """Starts it and waits until it can be connected to; the arguments are those of `server.serve`.

        Raises RigError device.disconnected, naming why.
        """
        self.address = address
        command = [sys.executable, "-m", "hardware_sim.controller", "--until-eof", "--address", address]
        command += ["--model", model, "--speed", repr(speed), "--log", log_level]
        # One word: the parser would take -1e-05 by itself for an option.
        command += ["--home=" + ",".join(repr(float(q)) for q in home)]
        command += ["--low-when-stopped", *map(str, low_when_stopped)]
        if calibration_seed is not None:
            command += [f"--calibration-seed={calibration_seed}", f"--calibration-error-m={calibration_error_m!r}"]
        for name, path in (("surroundings", surroundings), ("programs", programs), ("record", record)):
            if path is not None:
                command += [f"--{name}", str(path)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # noqa: S603
        deadline = time.monotonic() + _START_TIMEOUT
        try:
            self._wait_until_ready(deadline)
        except RigError:
            self.close()
            raise

    def _wait_until_ready(self, deadline: float) -> None:
        stdout = self.process.stdout
        if stdout is not None:
            readable, _, _ = select.select([stdout], [], [], max(0.0, deadline - time.monotonic()))
            if readable and stdout.readline().startswith(b"ready"):
                return
        raise RigError(
            ErrorCode.DEVICE_DISCONNECTED,
            f"the simulated controller did not start at {self.address}; its log says why",
            exit_code=self.process.poll(),
        )

    def control(self) -> ControlClient:
        """A new client of its control port."""
        return ControlClient(self.address)

    def kill(self) -> None:
        """Ends it without warning, as a power cut."""
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """Ends it; harmless when it has ended."""
        if self.process.stdin is not None:
            self.process.stdin.close()
        try:
            self.process.wait(3.0)
        except subprocess.TimeoutExpired:
            self.kill()
        if self.process.stdout is not None:
            self.process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
