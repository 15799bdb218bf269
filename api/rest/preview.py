"""A frame as a picture for people: 8 bits, brightened so that shadows can be seen."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import tifffile

from acquisition.models.calibration import SensorModel
from acquisition.models.errors import ErrorCode, RigError

GAMMA = 2.2
JPEG_QUALITY = 85
LONGEST_SIDE = 1280
"""Of a JPEG, px: more a browser's window does not show."""
MOST_GAIN = 16.0
"""A JPEG of a dark frame is brightened by no more than this, or it would be noise."""

Pixels = npt.NDArray[np.uint16]


def png(path: Path, sensor: SensorModel) -> bytes:
    """A stored frame (linear 16-bit TIFF) as an 8-bit PNG from black level to full scale, gamma 2.2.

    The scale is the sensor's, not the frame's own, so that pictures of one session can be compared. Raises RigError
    store.corrupt when the file is missing or damaged.
    """
    return _encoded(".png", _table(sensor, 1.0)[pixels_of(path)], [])


def jpeg(pixels: Pixels, sensor: SensorModel) -> bytes:
    """A frame (H, W) uint16 linear as a JPEG of at most `LONGEST_SIDE`, its 99.5th percentile white, gamma 2.2."""
    bright = (float(np.percentile(pixels, 99.5)) - sensor.black_level_dn) / sensor.full_scale_dn
    picture = _table(sensor, float(np.clip(1 / max(bright, 1e-6), 1.0, MOST_GAIN)))[pixels]
    scale = LONGEST_SIDE / max(picture.shape)
    if scale < 1:
        height, width = picture.shape
        size = (round(width * scale), round(height * scale))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    return _encoded(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def pixels_of(path: Path) -> Pixels:
    """A stored frame. Raises RigError store.corrupt when the file is missing or damaged."""
    try:
        return tifffile.imread(path)
    except (OSError, ValueError, tifffile.TiffFileError) as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name}: {error}", file=path.name) from error


def _table(sensor: SensorModel, gain: float) -> npt.NDArray[np.uint8]:
    """What each of the 65536 values is shown as."""
    signal = np.clip(gain * (np.arange(65536) - sensor.black_level_dn) / sensor.full_scale_dn, 0, 1)
    return np.round(255 * signal ** (1 / GAMMA)).astype(np.uint8)


def _encoded(suffix: str, picture: npt.NDArray[np.uint8], settings: list[int]) -> bytes:
    written, encoded = cv2.imencode(suffix, picture, settings)
    if not written:
        raise RigError(ErrorCode.SERVICE_FAULT, f"A picture of shape {picture.shape} cannot be written as {suffix}")
    return encoded.tobytes()
