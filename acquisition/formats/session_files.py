"""Names of the files by which a session's folder is known, and the refusals to write anything else into one."""

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
    folder = _session_around(path)
    if folder is not None:
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{option} {path}: lies in the session's folder {folder}, which holds only what the session recorded: "
            "name a place outside it",
            file=str(path),
        )


def refuse_session_as_data(path: Path) -> None:
    """Refuses a session's folder, or a place within one, as a service's data folder.

    Raises RigError folder.invalid with the data folder that the session belongs to, if it lies in one.
    """
    folder = _session_around(path)
    if folder is not None:
        data = folder.parent.parent
        known = folder.parent.name == "sessions" and (data / "rig.db").is_file()
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{path} is no data folder: it {'is' if folder == path.resolve() else 'lies in'} the folder of the session "
            f"{folder.name}; "
            + (f"name the data folder that holds this session: {data}" if known else "name a folder outside it"),
            file=str(path),
        )


def _session_around(path: Path) -> Path | None:
    """Returns the session's folder that a path names or lies in; None if there is none."""
    place = path.resolve()
    return next((folder for folder in (place, *place.parents) if is_session(folder)), None)
