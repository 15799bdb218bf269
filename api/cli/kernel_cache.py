"""The folder of compiled kernels: without one that can be written, numba refuses to load any kernel."""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import acquisition
from acquisition.models.errors import ErrorCode, RigError

COMMANDS = frozenset({"demo", "sim", "serve", "check", "study", "solve", "plan", "replay", "calibrate", "warm"})
"""Commands that load kernels, or start a process that does."""


def require_writable() -> None:
    """Raises RigError config.invalid unless kernels can be stored in one of the folders that numba tries.

    Else a service would start and say that it is ready, and each of its sessions would fail.
    """
    folders = list(_folders())
    if not any(_is_writable(folder) for folder in folders):
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"compiled kernels cannot be stored in {' or '.join(map(str, folders))}: set NUMBA_CACHE_DIR to a folder "
            "that this user can write",
        )


def _folders() -> Iterator[Path]:
    """The folders that numba tries, in its order, without those of notebooks and zip files."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(given)
    yield Path(acquisition.__file__).parent / "__pycache__"
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    yield Path(caches) / "numba"


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
