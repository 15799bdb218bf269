"""A look through the camera for people, while no session holds the rig.

The camera belongs to the runner's thread, so a look is a request to it like any other, and it gives way at once to a
session that starts. Whoever looks while a session holds the rig is refused: the frames that it takes are the view then.
"""

from collections.abc import Callable

from acquisition.devices import Frame, Rig, StopToken
from acquisition.models.errors import ErrorCode, Halted, RigError

InThread = Callable[[Callable[[], Frame]], Frame]


class Looking:
    """Takes single frames; `look` and `give_way` may be called from any thread."""

    def __init__(self, rig: Rig, refuse_held: Callable[[], None], in_thread: InThread) -> None:
        """`refuse_held` raises RigError rig.busy while a session holds the rig; `in_thread` runs work in the runner's
        thread.
        """
        self._rig = rig
        self._refuse_held = refuse_held
        self._in_thread = in_thread
        self._token = StopToken()

    def look(self, exposure_s: float) -> Frame:
        """One frame; lamp and arm stay as they are.

        Raises RigError rig.busy, rig.not_ready, request.invalid, camera.unreachable, camera.timeout,
        device.disconnected.
        """
        self._refuse_held()
        token = self._token = StopToken()

        def expose() -> Frame:
            self._refuse_held()  # again: a session may have started while this waited for its turn
            return self._rig.camera.expose(exposure_s, 0, token)

        try:
            return self._in_thread(expose)
        except Halted as error:
            raise RigError(ErrorCode.RIG_BUSY, "A session has started") from error

    def give_way(self) -> None:
        """Ends the look that is being taken, if any."""
        self._token.set()
