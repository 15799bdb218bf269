"""Names of the files by which a session's folder is known, and the refusal to write anything else into one."""

from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError

RECIPE, CELL, CALIBRATION, MANIFEST = "recipe.json", "cell.json", "calibration.json", "manifest.json"


def is_session(folder: Path) -> bool:
    """Whether a folder is a session's."""
    return (folder / RECIPE).is_file() and (folder / CALIBRATION).is_file()


def refuse_in_session(path: Path, option: str) -> None:
    """Refuses to write a file or folder within a session's folder, where only the service writes.

    `option` is what names `path`. Raises RigError folder.invalid with the session's folder.
    """
    place = path.resolve()
    for folder in (place, *place.parents):
        if is_session(folder):
            raise RigError(
                ErrorCode.FOLDER_INVALID,
                f"{option} {path}: lies in the session's folder {folder}, which holds only what the session recorded: "
                "name a place outside it",
                file=str(path),
            )
