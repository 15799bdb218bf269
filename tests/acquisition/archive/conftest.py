"""Archives of small sessions."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from acquisition.archive.archive import Archive
from tests.acquisition.archive import session_copies


@pytest.fixture
def archive(tmp_path: Path) -> Iterator[Archive]:
    """An empty archive in a folder."""
    opened = Archive(str(tmp_path / "archive"), create=True)
    yield opened
    opened.close()


@pytest.fixture
def session_folder(tmp_path: Path) -> Callable[..., Path]:
    """Makes a small ended session."""
    return lambda name="20261121-190041-aaaaaa", seed=0, **more: session_copies.make(tmp_path / name, seed, **more)
