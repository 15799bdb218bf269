"""Arrays that may be larger than memory.

Their file is in the system's folder for such files (`TMPDIR`), which ought to be on a disk.
"""

import mmap
import tempfile
from collections.abc import Iterator
from typing import cast

import numpy as np

LARGE_BYTES = 1 << 28
"""Above this size an array lives in a file without a name, so that memory holds only what is touched."""


def zeros(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros (uint8) in memory or, where they would fill it, in a file that is gone with the array."""
    size = int(np.prod(shape))
    if size < LARGE_BYTES:
        return np.zeros(shape, np.uint8)
    with tempfile.TemporaryFile() as file:
        file.truncate(size)
        return np.ndarray(shape, np.uint8, buffer=mmap.mmap(file.fileno(), size))


def iterate(array: np.ndarray) -> Iterator[np.ndarray]:
    """The items of what `zeros` gave, one after another, each let go before the next."""
    for item in array:
        yield item
        release(array)


def release(array: np.ndarray) -> None:
    """Lets what was touched of what `zeros` gave leave memory, if it has a file; nothing is lost."""
    file = cast(object, array.base)
    if isinstance(file, mmap.mmap):
        file.madvise(mmap.MADV_DONTNEED)
