"""Reading of a session folder's frames by rows. It needs only the files, not the journal, so a folder can be copied."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import tifffile

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import FrameRef


@dataclass(frozen=True)
class FolderFrames:
    """The frames of one session folder as a FrameSource; picklable, since it holds a path only."""

    folder: Path

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Rows [start, stop) of a frame. Raises RigError store.corrupt when the file is missing or cut short."""
        path = self.folder / frame.path
        try:
            pixels = tifffile.memmap(path, mode="r")
        except (OSError, ValueError, tifffile.TiffFileError) as error:
            raise RigError(ErrorCode.STORE_CORRUPT, f"{frame.path}: {error}", file=frame.path) from error
        if pixels.shape != (frame.height, frame.width) or pixels.dtype != np.uint16:
            raise RigError(
                ErrorCode.STORE_CORRUPT,
                f"{frame.path}: {pixels.shape} {pixels.dtype}, expected {(frame.height, frame.width)} uint16",
                file=frame.path,
            )
        return np.asarray(pixels[start:stop])
