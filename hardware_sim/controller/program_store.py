"""Programs and installations that clients load by name or path, from a folder that stands for `/programs`.

A real `.urp` file has PolyScope's own format; here `name.urp` holds the script itself, which matters to clients.
"""

import time
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

_ROOTS = ("/programs/", "/ursim/programs/", "/")  # on a robot, and in UR's own simulator


@dataclass(frozen=True)
class LoadedProgram:
    """A program that has been loaded."""

    name: str
    path: str
    text: str


def _inside(folder: Path | None, name: str) -> Path | None:
    """The path of a name or absolute path inside the folder; None without a folder, or if it leads out of it."""
    if folder is None:
        return None
    path = (folder / next((name.removeprefix(root) for root in _ROOTS if name.startswith(root)), name)).resolve()
    return path if path.is_relative_to(folder.resolve()) else None


def find(folder: Path | None, name: str) -> LoadedProgram | None:
    """The program of that name or path, or None."""
    path = _inside(folder, name) if name.endswith(".urp") else None
    if folder is None or path is None or not path.is_file():
        return None
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    return LoadedProgram(path.name, f"/programs/{path.relative_to(folder.resolve())}", text)


def has_installation(folder: Path | None, name: str) -> bool:
    """Whether an installation of this name exists; the default one always does."""
    path = _inside(folder, name)
    return name.endswith(".installation") and (Path(name).stem == "default" or (path is not None and path.is_file()))


def support_file(folder: Path | None, directory: str, serial: str, messages: Iterable[str]) -> str | None:
    """Writes an archive of the log into a directory; returns its name, or None without directory. Raises OSError."""
    inside = _inside(folder, directory)
    if inside is None or not inside.is_dir():
        return None
    name = f"ur_{serial}_{time.strftime('%Y-%m-%d_%H-%M-%S')}.zip"
    with zipfile.ZipFile(inside / name, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log_history.txt", "\n".join(messages))
    return name
