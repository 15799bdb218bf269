"""Routes of the archive: its page, sessions, pictures, files and exports. All of them only read.

The page is a bundle of its own (`api/page/built-archive`) under the policy of the operator's page. It is served without
a key and asks for the key itself. A file is named by its hash and never changes, so it is cached for good. A session's
picture and details depend on its newest result and are revalidated.
"""

from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, BinaryIO

from fastapi import APIRouter, Depends, Query, Request
from fastapi import Path as InPath
from fastapi.responses import Response, StreamingResponse

from acquisition.archive.entries import FileEntry
from acquisition.models.errors import ErrorCode, RigError
from api.rest import page, problems, static_files, stored_files
from api.rest.archive_page import exporting, listing, pictures
from api.rest.archive_page.exporting import Form
from api.rest.archive_page.reading import ReadArchive
from api.rest.archive_page.schemas import ROOT, ArchivedResult, ArchivedSession, ArchivedSessionDetails, listed
from api.rest.dependencies import refuse_unknown_query
from api.rest.schemas import Page
from api.rest.static_files import StaticFile

BLOCK_BYTES = 1 << 20
KNOWN = problems.responses_of(
    ErrorCode.ARCHIVE_NOT_FOUND, ErrorCode.ARCHIVE_DAMAGED, ErrorCode.ARCHIVE_UNREACHABLE, ErrorCode.SERVICE_OVERLOADED
)


async def _archive(request: Request) -> ReadArchive:
    return request.app.state.archive


ArchiveOf = Annotated[ReadArchive, Depends(_archive)]
Key = Annotated[str, InPath(pattern="^[0-9a-f]{64}$", description="The session's key")]

router = APIRouter(tags=["archive"])


@cache
def bundle() -> dict[str, StaticFile]:
    """Reads the built bundle, by file name, once per process."""
    return static_files.read("api", "page", "built-archive")


pages = static_files.router("/archive", "/archive/page", bundle, page.CONTENT_SECURITY_POLICY)


@router.get(
    ROOT, dependencies=[Depends(refuse_unknown_query)], responses=problems.responses_of(ErrorCode.ARCHIVE_QUERY_INVALID)
)
async def archived_sessions(
    archive: ArchiveOf,
    search: Annotated[str, Query(max_length=200, description="Part of object, id or notes; case is ignored")] = "",
    where: Annotated[str, Query(max_length=1000, description="A condition, such as `solver < '0.2'`")] = "",
    limit: Annotated[int, Query(ge=1, le=200, description="Maximum number of sessions per page")] = 50,
    after: Annotated[str, Query(max_length=120, description="Where the page begins; `next` holds it")] = "",
) -> Page[ArchivedSession]:
    """Lists the sessions of the archive, newest first."""
    return await archive.read(listing.page, archive, search, where, limit, after)


@router.get(f"{ROOT}/{{key}}", responses=KNOWN)
async def archived_session(archive: ArchiveOf, key: Key) -> ArchivedSessionDetails:
    """Returns one session with its files and results."""
    return await archive.read(_details, archive, key)


@router.get(
    f"{ROOT}/{{key}}/picture.jpg",
    response_class=Response,
    responses={**stored_files.binary("image/jpeg", description="The picture"), **stored_files.NOT_MODIFIED, **KNOWN},
)
async def archived_picture(
    archive: ArchiveOf,
    key: Key,
    width: Annotated[int, Query(ge=16, le=1024, description="Width in px; a narrower one is not enlarged")] = 240,
) -> Response:
    """Returns a small picture of a session: its newest normals, or its first image."""
    file = await archive.read(pictures.shown, archive, key)
    content = await archive.paint(pictures.picture, archive, key, file, width)
    return Response(content, media_type="image/jpeg", headers=stored_files.revalidated(f"{file.sha256}-{width}"))


@router.get(
    f"{ROOT}/{{key}}/files/{{path:path}}",
    response_class=StreamingResponse,
    responses={
        **stored_files.binary(*stored_files.ARTEFACT_TYPES, description="The file"),
        **stored_files.NOT_MODIFIED,
        **KNOWN,
    },
)
async def archived_file(
    archive: ArchiveOf, key: Key, path: Annotated[str, InPath(max_length=300, description="As `files` lists it")]
) -> StreamingResponse:
    """Returns one file of a session or of a result, checked by its hash."""
    file, content = await archive.read(_file, archive, key, path)
    name = path.rpartition("/")[2]
    kind = stored_files.MEDIA_TYPES.get(f".{name.rpartition('.')[2]}", "application/octet-stream")
    headers = {"Content-Length": str(file.bytes), **stored_files.immutable(file.sha256)}
    return StreamingResponse(_blocks(content), media_type=kind, headers=headers)


@router.get(
    f"{ROOT}/{{key}}/export",
    response_class=StreamingResponse,
    responses={**stored_files.binary("application/zip", description="The zip file"), **KNOWN},
)
async def archived_export(
    archive: ArchiveOf,
    key: Key,
    form: Annotated[
        Form,
        Query(description="`folder`: as `lightpose solve` reads it; `bagit`: a bag with RO-Crate metadata; `relight`"),
    ] = "bagit",
) -> StreamingResponse:
    """Returns a session with all its results as a zip file, made on request."""
    row = await archive.read(archive.row, key)
    name = f"{_safe(row.session_id)}-{form}"
    made = await exporting.export(archive, key, form, name)
    return StreamingResponse(
        made,
        media_type="application/zip",
        headers={
            "Content-Length": str(made.bytes),
            "Content-Disposition": f'attachment; filename="{name}.zip"',
            "Cache-Control": "no-store",
        },
    )


def _details(archive: ReadArchive, key: str) -> ArchivedSessionDetails:
    row, entry = archive.row(key), archive.session(key)
    results: list[ArchivedResult] = []
    for one in archive.archive().catalogue.results(key):
        files = archive.result(key, one.solver, one.settings).files if one.state == "done" else {}
        results.append(ArchivedResult.of(one, files))
    shown: dict[str, Any] = dict(ArchivedSession.of(row))
    return ArchivedSessionDetails(**shown, files=listed(entry.files), results=results)


def _file(archive: ReadArchive, key: str, path: str) -> tuple[FileEntry, BinaryIO]:
    """Returns a file's entry and checked content. Raises RigError archive.not_found, archive.damaged."""
    archive.row(key)
    found = archive.session(key).files.get(path)
    if found is None and path.startswith("results/"):
        results = (archive.result(key, row.solver, row.settings) for row in archive.finished(key))
        found = next((result.files[path] for result in results if path in result.files), None)
    if found is None:
        raise RigError(ErrorCode.ARCHIVE_NOT_FOUND, f"Session {key[:12]} has no file {path[:200]!r}")
    return found, archive.opened(found)


def _blocks(content: BinaryIO) -> Iterator[bytes]:
    with content:
        while block := content.read(BLOCK_BYTES):
            yield block


def _safe(name: str) -> str:
    """Returns a session's id as a file name; ids of other releases may contain any character."""
    return "".join(sign if sign.isascii() and (sign.isalnum() or sign in "-_.") else "_" for sign in name)[:80]
