"""Programs that the dashboard can load by name: text files of URScript in a folder.

A real `.urp` file is PolyScope's own format; here `name.urp` holds the script itself, which is what matters to clients.
"""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class LoadedProgram:
    """A program that the dashboard has loaded."""

    name: str
    text: str


def find(folder: Path | None, name: str) -> LoadedProgram | None:
    """The program of that name in a folder, or None; a name never leads out of the folder."""
    if folder is None or not name.endswith(".urp"):
        return None
    path = (folder / name.removeprefix("/programs/")).resolve()
    if not path.is_relative_to(folder.resolve()) or not path.is_file():
        return None
    try:
        return LoadedProgram(name, path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return None
