"""A frame as a picture for people: 8 bits, brightened so that shadows can be seen."""

from pathlib import Path

import cv2
import numpy as np
import tifffile

from acquisition.errors import ErrorCode, RigError
from acquisition.types import SensorModel

GAMMA = 2.2


def png(path: Path, sensor: SensorModel) -> bytes:
    """A stored frame (linear 16-bit TIFF) as an 8-bit PNG from black level to full scale, gamma 2.2.

    The scale is the sensor's, not the frame's own, so that pictures of one session can be compared. Raises RigError
    store.corrupt when the file is missing or damaged.
    """
    try:
        pixels = tifffile.imread(path)
    except (OSError, ValueError, tifffile.TiffFileError) as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name}: {error}", file=path.name) from error
    signal = np.clip((np.arange(65536) - sensor.black_level_dn) / sensor.full_scale_dn, 0, 1)
    table = np.round(255 * signal ** (1 / GAMMA)).astype(np.uint8)
    written, encoded = cv2.imencode(".png", table[pixels])
    if not written:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name} cannot be shown", file=path.name)
    return encoded.tobytes()
