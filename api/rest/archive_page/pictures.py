"""Small pictures of archived sessions: the newest result's normals, or the first image of an unsolved session."""

from io import BytesIO

import cv2
import numpy as np
import tifffile

from acquisition.archive.entries import FileEntry, SessionEntry
from acquisition.formats.folders import session_folder
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from api.rest import image_encoding
from api.rest.archive_page.reading import ReadArchive

NORMALS = "normals.png"


def shown(archive: ReadArchive, key: str) -> FileEntry:
    """Returns the file from which a session's picture is made.

    Raises RigError archive.not_found for an unknown session and for one without images.
    """
    archive.row(key)
    for row in archive.finished(key):
        for path, file in archive.result(key, row.solver, row.settings).files.items():
            if path.rpartition("/")[2] == NORMALS:
                return file
    images = _images(archive.session(key))
    if not images:
        raise RigError(ErrorCode.ARCHIVE_NOT_FOUND, f"Session {key[:12]} has no image")
    return images[0]


def picture(archive: ReadArchive, key: str, file: FileEntry, width: int) -> bytes:
    """Returns that file as a JPEG of at most `width` px. Raises RigError archive.damaged."""

    def make() -> bytes:
        content, entry = archive.content(file), archive.session(key)
        if file in _images(entry):
            calibration = Calibration.model_validate_json(archive.content(entry.files[session_folder.CALIBRATION]))
            return image_encoding.thumbnail(tifffile.imread(BytesIO(content)), calibration.sensor, width)
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        if pixels is None:
            raise RigError(ErrorCode.ARCHIVE_DAMAGED, f"{NORMALS} of session {key[:12]} is not a picture")
        return image_encoding.small(pixels.astype(np.uint8), width)

    return archive.pictures.of((file.sha256, width), make)


def _images(entry: SessionEntry) -> list[FileEntry]:
    return [file for path, file in sorted(entry.files.items()) if "/shots/" in path and path.endswith(".tiff")]
