"""Preview frames of the camera while no session holds the rig.

The camera belongs to the runner's thread, so a preview frame is a request to that thread like any other, and a session
that starts preempts it. While a session holds the rig, a preview is refused: the session's own frames are shown then.
"""

from collections.abc import Callable

from acquisition.devices import Frame, Rig, StopToken
from acquisition.models.errors import ErrorCode, Halted, RigError

InThread = Callable[[Callable[[], Frame]], Frame]


class Preview:
    """Takes single frames; `take_frame` and `preempt` may be called from any thread."""

    def __init__(self, rig: Rig, refuse_held: Callable[[], None], in_thread: InThread) -> None:
        """`refuse_held` raises RigError rig.busy while a session holds the rig; `in_thread` runs work in the runner's
        thread."""
        self._rig = rig
        self._refuse_held = refuse_held
        self._in_thread = in_thread
        self._token = StopToken()

    def take_frame(self, exposure_s: float) -> Frame:
        """Takes one frame; lamp and arm stay as they are.

        Raises RigError rig.busy, rig.not_ready, request.invalid, camera.unreachable, camera.timeout,
        device.disconnected.
        """
        self._refuse_held()
        token = self._token = StopToken()

        def expose() -> Frame:
            self._refuse_held()  # again: a session may have started while this was queued
            return self._rig.camera.expose(exposure_s, 0, token)

        try:
            return self._in_thread(expose)
        except Halted as error:
            raise RigError(ErrorCode.RIG_BUSY, "A session has started: ask again later") from error

    def preempt(self) -> None:
        """Ends the exposure in progress, if any: a session has priority."""
        self._token.set()
