"""A RAW file (DNG) of given sensor values, made by tests: Bayer's mosaic, black level 64, uncompressed."""

import io

import numpy as np
import numpy.typing as npt
import tifffile

CFA, BLACK_LEVEL = 32803, 64


def dng(pixels: npt.NDArray[np.uint16], exposure: tuple[int, int] = (1, 50), white_level: int = 4095) -> bytes:
    """The bytes of a DNG of values (H, W), sites R G / G B."""
    content = io.BytesIO()
    tags = [
        (254, "I", 1, 0, True), (271, "s", 0, "lightpose", True), (272, "s", 0, "tests", True),
        (33421, "H", 2, (2, 2), True), (33422, "B", 4, bytes([0, 1, 1, 2]), True),
        (33434, "2I", 1, exposure, True),
        (50706, "B", 4, bytes([1, 4, 0, 0]), True), (50707, "B", 4, bytes([1, 1, 0, 0]), True),
        (50708, "s", 0, "tests", True), (50714, "H", 1, BLACK_LEVEL, True), (50717, "H", 1, white_level, True),
        (50721, "2i", 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True),
        (50728, "2I", 3, (1, 1, 1, 1, 1, 1), True), (50778, "H", 1, 21, True),
    ]  # fmt: skip
    tifffile.imwrite(content, pixels, photometric=CFA, extratags=tags, metadata=None, software=None)
    return content.getvalue()
