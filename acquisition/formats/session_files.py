"""Names of the files by which a session's folder is known, and the refusals to write anything else into one."""

from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError

RECIPE, CELL, CALIBRATION, MANIFEST = "recipe.json", "cell.json", "calibration.json", "manifest.json"

JOURNAL, KEPT_FOLDERS = "rig.db", ("sessions", "calibrations", "cache")
"""Names of a data folder's journal and of the folders that the service keeps beside it."""


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


def refuse_as_data(path: Path) -> None:
    """Refuses a session's folder, or a place within one or within another data folder, as a service's data folder.

    Raises RigError folder.invalid with the data folder that it lies in, if any.
    """
    place = path.resolve()
    folder, data = _session_around(path), _data_folder_around(place)
    if folder is None and data is None:
        return
    around = f"data folder {data}" if folder is None else f"folder of the session {folder.name}"
    held = "it" if folder is None else "this session"
    raise RigError(
        ErrorCode.FOLDER_INVALID,
        f"{path} is no data folder: it {'is' if folder == place else 'lies in'} the {around}; "
        + ("name a folder outside it" if data is None else f"name the data folder that holds {held}: {data}"),
        file=str(path),
    )


def _data_folder_around(place: Path) -> Path | None:
    """Returns the data folder in whose sessions, calibrations or cache a place is; None if there is none."""
    kept = (folder.parent for folder in (place, *place.parents) if folder.name in KEPT_FOLDERS)
    return next((data for data in kept if (data / JOURNAL).is_file()), None)


def _session_around(path: Path) -> Path | None:
    """Returns the session's folder that a path names or lies in; None if there is none."""
    place = path.resolve()
    return next((folder for folder in (place, *place.parents) if is_session(folder)), None)
