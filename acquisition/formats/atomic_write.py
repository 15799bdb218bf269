"""Atomic writing of folders: written under a hidden name in the same parent folder, then renamed.

A process that is killed leaves the hidden folder behind. Whoever knows that nobody writes there any more discards it.
"""

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


def discard_partial(folder: Path) -> None:
    """Removes what killed processes have left of `atomic_folder(folder)`."""
    for partial in folder.parent.glob(f".{folder.name}.*"):
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def written_by_job(folder: Path) -> Generator[None]:
    """For the time in which another process makes `folder`: nothing is left of an earlier attempt, nor of this one when
    it fails, because its process may have been killed while it wrote.

    For a folder that nothing refers to yet: what stands there was left by a crash before its entry in the journal.
    """
    if folder.exists():
        shutil.rmtree(folder)
    try:
        yield
    except BaseException:
        discard_partial(folder)
        raise


@contextmanager
def atomic_folder(folder: Path) -> Generator[Path]:
    """Yields a hidden folder to write into; it takes the name `folder` when the block ends, and is gone when it fails.

    What stood there before is replaced as a whole.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        yield partial
        partial.chmod(0o755)
        if folder.exists():
            shutil.rmtree(folder)
        partial.rename(folder)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
