"""The controller as a child process that ends with its parent."""

import select
import subprocess
import sys
from contextlib import AbstractContextManager

from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions

_START_TIMEOUT = 90.0  # s; it usually starts in well under 1 s, on a machine with other load in 35 s


class ControllerProcess(AbstractContextManager["ControllerProcess"]):
    """A controller in a child process, as a context manager.

    The child reads a pipe that only this process holds open, so it ends with its parent, however that dies.
    """

    def __init__(
        self, address: str, options: ControllerOptions, *, log_level: str = "WARNING", module: str = __package__ or ""
    ) -> None:
        """Starts it and waits until clients can connect. Raises ConnectionError if it does not start.

        `python -m` runs `module`; a module other than this package has to call this package's `__main__.main`.
        """
        self.address = address
        command = [sys.executable, "-m", module, "--until-eof", "--address", address, "--log", log_level]
        for name, value in vars(options).items():
            flag = "--" + name.replace("_", "-")
            if name == "low_when_stopped":
                command += [flag, *map(str, value)]
            elif name == "home":
                command += [f"{flag}={','.join(repr(float(q)) for q in value)}"]
            elif value is True:
                command += [flag]
            elif value is not None and value is not False:
                command += [f"{flag}={value}"]  # one word: the parser would take a separate -1e-05 as an option
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # noqa: S603
        output = self.process.stdout
        readable = output is not None and select.select([output], [], [], _START_TIMEOUT)[0]
        if output is None or not readable or not output.readline().startswith(b"ready"):
            self.close()
            raise ConnectionError(f"the simulated controller did not start at {self.address}; see its log")

    def control(self) -> ControlClient:
        """Returns a new client of its control port."""
        return ControlClient(self.address)

    def kill(self) -> None:
        """Ends it without warning, like a power cut."""
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """Ends it; has no effect if it has ended already."""
        if self.process.stdin is not None:
            self.process.stdin.close()
        try:
            self.process.wait(3.0)
        except subprocess.TimeoutExpired:
            self.kill()
        if self.process.stdout is not None:
            self.process.stdout.close()

    def __exit__(self, *exception: object) -> None:
        self.close()
