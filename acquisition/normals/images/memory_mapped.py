"""Memory-mapped arrays that may be larger than memory.

Their file is in the system's folder for temporary files (`TMPDIR`), which should be on a disk.
"""

import mmap
import tempfile
from collections.abc import Iterator
from typing import cast

import numpy as np

LARGE_BYTES = 1 << 28
"""Size from which an array is mapped to an unnamed file, so that memory holds only the pages in use."""


def zeros(shape: tuple[int, ...], dtype: type[np.generic] = np.uint8) -> np.ndarray:
    """Allocates zeros in memory or, from LARGE_BYTES on, in a file that is deleted with the array."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if size < LARGE_BYTES:
        return np.zeros(shape, dtype)
    with tempfile.TemporaryFile() as file:
        file.truncate(size)
        return np.ndarray(shape, dtype, buffer=mmap.mmap(file.fileno(), size))


def iterate(array: np.ndarray) -> Iterator[np.ndarray]:
    """Iterates over the items of an array of `zeros`, and releases the memory of each before the next."""
    for item in array:
        yield item
        release(array)


def release(array: np.ndarray) -> None:
    """Releases the pages of an array of `zeros`, or of a view of one, from memory if it has a file (MADV_DONTNEED); its
    values stay."""
    file = cast(object, array.base)
    while isinstance(file, np.ndarray):
        file = cast(object, file.base)
    if isinstance(file, mmap.mmap):
        file.madvise(mmap.MADV_DONTNEED)
