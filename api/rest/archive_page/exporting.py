"""Exports of archived sessions on demand, as zip files: written by a separate process, then streamed and removed.

An export hashes a bag's files or renders Relight's images, which takes a core for seconds to minutes. In a process of
low priority this delays neither the answers of this one nor a cell. Only one export is made at a time.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import anyio.to_process
from zipstream import ZIP_STORED, ZipStream

from acquisition import process_priority
from acquisition.archive import exports
from acquisition.archive.archive import Archive
from api.rest.archive_page.reading import SCRATCH, ReadArchive
from api.rest.turns import refuse_crowd

Form = Literal["folder", "bagit", "relight"]


class Export:
    """An exported session as the bytes of a zip file. Its folder is removed when they have been read."""

    def __init__(self, folder: "tempfile.TemporaryDirectory[str]", name: str) -> None:
        self._folder = folder
        self._packed = ZipStream(compress_type=ZIP_STORED, sized=True)
        self._packed.add_path(Path(folder.name) / name, name)
        self.bytes = len(self._packed)

    def __iter__(self) -> Iterator[bytes]:
        try:
            yield from self._packed
        finally:
            self._folder.cleanup()


async def export(archive: ReadArchive, key: str, form: Form, name: str) -> Export:
    """Exports a session into the folder `name` of a zip file.

    Raises RigError as `exports.write`, service.overloaded, store.disk_full.
    """
    refuse_crowd(archive.exporting)
    folder = tempfile.TemporaryDirectory(prefix=SCRATCH)
    out = str(Path(folder.name) / name)
    try:
        await anyio.to_process.run_sync(
            _write, archive.address, archive.catalogue_address, key, form, out,
            cancellable=True, limiter=archive.exporting,
        )  # fmt: skip
        return Export(folder, name)
    except BaseException:
        folder.cleanup()
        raise


def _write(address: str, catalogue: str | None, key: str, form: Form, out: str) -> None:
    process_priority.set_niceness(process_priority.BACKGROUND)
    archive = Archive(address, catalogue)
    try:
        exports.write(archive, key, form, Path(out))
    finally:
        archive.close()
