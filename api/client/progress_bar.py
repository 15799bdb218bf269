"""The progress bar that `capture` shows on a terminal while a session runs."""

from types import TracebackType

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from api.rest.schemas import SessionResource


class SessionProgressBar:
    """Progress bar of one session with its state, its stage and the time left; a context manager."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
        )
        self._task = self._progress.add_task("", total=1.0, left="")

    def __enter__(self) -> "SessionProgressBar":
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def update(self, session: SessionResource) -> None:
        """Shows the session as it is now."""
        left = "" if session.seconds_left is None else f"{session.seconds_left:.0f} s left"
        self._progress.update(
            self._task, completed=session.progress, description=f"{session.state}: {session.stage}", left=left
        )
