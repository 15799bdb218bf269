"""Arrays that may be larger than memory."""

import tempfile

import numpy as np

LARGE_BYTES = 1 << 29
"""Above this size an array lives in a file without a name, so that memory holds only what is touched."""


def zeros(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros (uint8) in memory or, where they would fill it, in a file that is gone with the array."""
    if int(np.prod(shape)) < LARGE_BYTES:
        return np.zeros(shape, np.uint8)
    with tempfile.TemporaryFile() as file:
        return np.memmap(file, np.uint8, "w+", shape=shape)
