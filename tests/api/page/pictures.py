"""Pixels of what a page shows."""

import cv2
import numpy as np
import numpy.typing as npt
from playwright.sync_api import Locator


def pixels(element: Locator) -> npt.NDArray[np.uint8]:
    """An element as it is on the screen, (H, W, 3)."""
    image = cv2.imdecode(np.frombuffer(element.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(np.uint8)


def contrast(element: Locator) -> float:
    """Standard deviation of an element's grey values, 0–255: 0 for a blank one."""
    return float(cv2.cvtColor(pixels(element), cv2.COLOR_BGR2GRAY).std())
