"""The controller as a child process that ends with its parent."""

import select
import subprocess
import sys
import time
from types import TracebackType
from typing import Self

from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions

_START_TIMEOUT = 90.0  # s; it starts in well under one, and on a machine that computes for others too in 35 s


class ControllerProcess:
    """Starts a controller and ends it; a context manager.

    The child reads a pipe that only this process holds open: it ends when the parent does, however that dies.
    """

    def __init__(
        self, address: str, options: ControllerOptions, *, log_level: str = "WARNING", module: str = __package__ or ""
    ) -> None:
        """Starts it and waits until it can be connected to. Raises ConnectionError where it does not start.

        `module`: what `python -m` runs; another one calls this package's `__main__.main`.
        """
        self.address = address
        command = [sys.executable, "-m", module, "--until-eof", "--address", address]
        command += ["--polyscope", options.polyscope, "--robot-api-port", str(options.robot_api_port)]
        command += ["--model", options.model, "--speed", repr(options.speed), "--log", log_level]
        # One word: the parser would take -1e-05 by itself for an option.
        command += ["--home=" + ",".join(repr(float(q)) for q in options.home)]
        command += ["--low-when-stopped", *map(str, options.low_when_stopped)]
        if options.calibration_seed is not None:
            command += [f"--calibration-seed={options.calibration_seed}"]
            command += [f"--calibration-error-m={options.calibration_error_m!r}"]
        if options.for_urx:
            command += ["--for-urx"]
        files = {"surroundings": options.surroundings, "programs": options.programs, "record": options.record}
        for name, path in files.items():
            if path is not None:
                command += [f"--{name}", str(path)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # noqa: S603
        deadline = time.monotonic() + _START_TIMEOUT
        try:
            self._wait_until_ready(deadline)
        except ConnectionError:
            self.close()
            raise

    def _wait_until_ready(self, deadline: float) -> None:
        stdout = self.process.stdout
        if stdout is not None:
            readable, _, _ = select.select([stdout], [], [], max(0.0, deadline - time.monotonic()))
            if readable and stdout.readline().startswith(b"ready"):
                return
        raise ConnectionError(f"the simulated controller did not start at {self.address}; its log says why")

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
