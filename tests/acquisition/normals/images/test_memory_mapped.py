"""Arrays in a file against arrays in memory."""

import mmap

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
