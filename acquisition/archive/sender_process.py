"""Starts the sender beside a service and ends it; imports none of the libraries that an archive needs.

A sender that ends by itself is started again after a minute; the log states what ended it, and sessions wait meanwhile.
"""

import importlib.util
import logging
import subprocess
import sys
import threading
from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError

RESTART_S = 60.0
CLOSE_S = 5.0

_log = logging.getLogger(__name__)


class SenderProcess:
    """The sender's process; `open` and `close` are called by the service."""

    def __init__(self, data: Path, address: str, catalogue: str | None) -> None:
        """Raises RigError config.invalid when the extra `archive` is not installed."""
        for name in ("fsspec", "sqlalchemy", "tenacity"):
            if importlib.util.find_spec(name) is None:
                raise RigError(
                    ErrorCode.CONFIG_INVALID,
                    f"LIGHTPOSE_ARCHIVE is set, but {name} is not installed: pip install 'lightpose[archive]'",
                )
        more = [] if catalogue is None else [catalogue]
        self._command = [sys.executable, "-m", "acquisition.archive.sender", str(data), address, *more]
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._supervise, name="archive", daemon=True)

    def open(self) -> None:
        """Starts the sender."""
        self._thread.start()

    def close(self) -> None:
        """Ends the sender; a push that is interrupted is repeated by the next one."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(2 * CLOSE_S)

    def _supervise(self) -> None:
        while not self._closing.is_set():
            process = subprocess.Popen(self._command, stdin=subprocess.PIPE)  # noqa: S603 - our own module
            while process.poll() is None and not self._closing.wait(0.2):
                pass
            if process.stdin is not None:
                process.stdin.close()
            if self._closing.is_set():
                try:
                    process.wait(CLOSE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
                return
            _log.warning("the archive's sender ended with status %s; it is started again", process.returncode)
            self._closing.wait(RESTART_S)
