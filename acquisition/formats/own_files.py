"""Folders with a list of the files that this program wrote, so that replacing one does not delete other people's work.

The list has the SHA-256 of each file. It is in a JSON file of the folder, under `files`, without that file itself.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, cast

from acquisition.models.errors import ErrorCode, RigError

LIST = "files"
LITTER = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})
"""Files that file managers create anywhere and nobody misses."""


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file below a folder, by its relative path with slashes."""
    return {path.relative_to(folder).as_posix(): _checksum(path) for path in sorted(folder.rglob("*")) if _kept(path)}


def refuse_foreign(folder: Path, sign: str) -> None:
    """Refuses a folder with files that this program did not write or that were changed since, by the list in `sign`.

    An empty folder, or none, is accepted. Raises RigError folder.invalid naming the first such file.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise _refusal(folder, "is not a folder: name one")
    try:
        first = next((path for path in sorted(folder.iterdir()) if path.name not in LITTER), None)
        if first is None:
            return
        if not (folder / sign).is_file():
            raise _refusal(
                folder, f"holds {first.name}, which this program did not write: name a new folder, or empty this one"
            )
        _refuse_unlisted(folder, sign, _listed(folder / sign))
    except OSError as error:
        raise _refusal(folder, f"cannot be read: {error}; name a new folder") from error


def _refuse_unlisted(folder: Path, sign: str, listed: dict[str, str]) -> None:
    changed: Path | None = None
    for path in sorted(folder.rglob("*")):
        if not _kept(path) or path == folder / sign:
            continue
        name = path.relative_to(folder).as_posix()
        if name not in listed:
            raise _refusal(
                folder,
                f"holds {name}, which this program did not write and would delete: move it elsewhere, or name a new "
                "folder",
            )
        if changed is None and _checksum(path) != listed[name]:
            changed = path
    if changed is not None:
        name = changed.relative_to(folder).as_posix()
        raise _refusal(
            folder,
            f"holds {name}, which was changed since this program wrote it and would be replaced: move it elsewhere, or "
            "name a new folder",
        )


def _listed(sign: Path) -> dict[str, str]:
    """Reads the list of a folder's files. Raises RigError folder.invalid if there is none."""
    try:
        content: Any = json.loads(sign.read_bytes())
    except ValueError:
        content = None
    listed: Any = cast(dict[str, Any], content).get(LIST) if isinstance(content, dict) else None
    if not isinstance(listed, dict):
        raise _refusal(
            sign.parent,
            f"its {sign.name} does not list the folder's files (it was written by an earlier release or another "
            "program), so it is not known what would be deleted: name a new folder, or remove this one",
        )
    return {str(name): str(digest) for name, digest in cast(dict[Any, Any], listed).items()}


def _kept(path: Path) -> bool:
    """Whether somebody may miss a path: anything but folders and litter."""
    return path.name not in LITTER and (path.is_symlink() or not path.is_dir())


def _checksum(path: Path) -> str:
    if not path.is_file():  # a link to nowhere or to a folder, a pipe
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _refusal(folder: Path, detail: str) -> RigError:
    return RigError(ErrorCode.FOLDER_INVALID, f"{folder}: {detail}", file=str(folder))
