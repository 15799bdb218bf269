"""Masks that are not only black and white: all that is not black counts, and a warning says so."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from acquisition.formats import folders
from tests.acquisition.formats.folders import small

MASK = small.sphere()[1].astype(np.uint8) * 255


@pytest.mark.parametrize(
    ("drawn", "told"),
    [
        (MASK, None),
        (MASK // 255, None),
        (np.dstack([MASK, MASK, MASK]), None),
        (cv2.GaussianBlur(MASK, (0, 0), 2), " % of what counts as object is grey"),
        (np.where(MASK > 0, MASK, 3).astype(np.uint8), " % of what counts as object is grey"),
    ],
    ids=["white", "ones", "colour", "soft", "not quite black"],
)
def test_read_grey_mask_is_told(drawn: np.ndarray, told: str | None, tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    cv2.imwrite(str(folder / "mask.png"), drawn)
    images = folders.read(folder, tmp_path)
    np.testing.assert_array_equal(images.mask, drawn.reshape(*MASK.shape, -1)[..., 0] > 0)
    said = [sentence for sentence in images.notes["warnings"] if sentence.startswith("mask.png is not only black")]
    assert [told in one for one in said] == ([True] if told else [])  # type: ignore[operator]
