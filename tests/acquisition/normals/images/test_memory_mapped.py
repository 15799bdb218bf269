"""Arrays in a file against arrays in memory."""

import mmap
from pathlib import Path

import numpy as np
import pytest

from acquisition.normals.images import memory_mapped


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("in_file", [False, True])
def test_release_written_array_keeps_its_values(
    in_file: bool, dtype: type[np.generic], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory_mapped, "LARGE_BYTES", 1 if in_file else 1 << 30)
    array = memory_mapped.zeros((3, 50, 1000), dtype)
    assert array.dtype == dtype
    assert isinstance(array.base, mmap.mmap) == in_file
    assert not np.any(array)
    array[1:, 10:20] = 7
    memory_mapped.release(array)
    expected = np.zeros((3, 50, 1000), dtype)
    expected[1:, 10:20] = 7
    np.testing.assert_array_equal(array, expected)
    np.testing.assert_array_equal(list(memory_mapped.iterate(array)), expected)


def resident_kb(array: np.ndarray) -> int:
    """Memory that the mapping of an array takes, by the kernel's account of this process."""
    address, within = array.ctypes.data, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        name, *values = line.split()
        if "-" in name and ":" not in name:
            first, last = (int(one, 16) for one in name.split("-"))
            within = first <= address < last
        elif within and name == "Rss:":
            return int(values[0])
    raise LookupError(hex(address))


@pytest.mark.parametrize("of", ["array", "view"])
def test_release_frees_the_memory_of_a_file_also_by_a_view(of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The final solve releases the flags of all images by the view that it writes."""
    monkeypatch.setattr(memory_mapped, "LARGE_BYTES", 1)
    array = memory_mapped.zeros((4, 100, 4096))
    array[:] = 7
    before = resident_kb(array)
    memory_mapped.release(array if of == "array" else array[:, 10:20][:, :, 5:])
    assert before == array.nbytes / 1024
    assert resident_kb(array) == 0
    assert np.all(array == 7)
