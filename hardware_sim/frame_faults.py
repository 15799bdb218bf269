"""Faults of the simulated camera and its link: frames that are lost, late, doubled or damaged, a bumped dial, a reset.

Each fault is ordered for a number of the next frames. A frame has one fault at most, in the order of the orders.
"""

import time
from collections import deque
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from acquisition.models.camera import FaultKind

Answer = tuple[dict[str, Any], npt.NDArray[np.uint16] | None]

MOST = 10_000


class FrameFaults:
    """Queue of ordered faults; `applied` is called under the camera's lock.

    For the fault `gone` the count is in seconds, not frames: for so long the camera answers no request.
    """

    def __init__(self) -> None:
        self._orders: deque[str] = deque()
        self._sent: deque[Answer] = deque(maxlen=2)
        self._away_until = 0.0

    @property
    def is_away(self) -> bool:
        """Whether the camera answers no request."""
        return time.monotonic() < self._away_until

    def order(self, kind: Any, count: Any) -> None:
        """Orders a fault. Raises ValueError that states what is wrong."""
        if isinstance(count, bool) or not isinstance(count, int) or not 0 < count <= MOST:
            raise ValueError(f"count must be an integer from 1 to {MOST}")
        if kind not in get_args(FaultKind) or kind == "returned":
            raise ValueError(f"fault must be one of {', '.join(get_args(FaultKind)[:-1])}")
        if kind == "gone":
            self._away_until = time.monotonic() + count
        else:
            self._orders.extend([kind] * count)

    def applied(self, header: dict[str, Any], frame: npt.NDArray[np.uint16]) -> Answer:
        """The answer to a request for a frame, disturbed if a fault is due."""
        due = self._orders.popleft() if self._orders else None
        earlier = {"doubled": -1, "late": 0}.get(due or "")
        if earlier is not None and self._sent:
            return self._sent[earlier]
        if due == "lost":
            return {"error": "the frame was lost on its way"}, None
        if due == "damaged":
            return {**header, "height": header["height"] // 2}, frame[: header["height"] // 2]
        if due == "settings":
            return {**header, "exposure_s": 2 * header["exposure_s"]}, frame
        self._sent.append((header, frame))
        return header, frame
