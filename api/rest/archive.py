"""Export of a session: its folder as one zip file, and its log as text.

The zip is streamed file by file and not compressed, because 16-bit frames hardly compress and a lab's disk is faster
than one core. It includes only completely written files. The journal's entries about the session are included, so that
the folder can be understood without the database.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from fastapi.responses import PlainTextResponse, StreamingResponse
from zipstream import ZIP_STORED, ZipStream

from acquisition.store import Event
from api.rest import problems, stored_files
from api.rest.dependencies import ServiceOf
from api.rest.schemas import as_datetime
from api.rest.sessions import SessionId
from api.rest.wiring import Service

router = APIRouter(tags=["sessions"])

EVENTS_PER_QUERY = 500

_PLAIN = re.compile(r"[\w.:/@+-]+")
"""Text that is logged unchanged; any other text is quoted."""


@router.get(
    "/v1/sessions/{session_id}/archive",
    response_class=StreamingResponse,
    responses={**stored_files.binary("application/zip", description="The zip file"), **problems.NOT_FOUND},
)
def archive(service: ServiceOf, session_id: SessionId) -> StreamingResponse:
    """Returns the session's folder as a zip file, with the journal's entries about it in `journal.jsonl`."""
    folder = service.store.folder(session_id)
    packed = ZipStream(compress_type=ZIP_STORED, sized=True)
    journal = "".join(json.dumps(entry, ensure_ascii=False) + "\n" for entry in _entries(service, session_id))
    packed.add(journal.encode(), f"{session_id}/journal.jsonl")
    for path in sorted(folder.rglob("*")):
        if _is_exportable(path, folder):
            packed.add_path(path, f"{session_id}/{path.relative_to(folder).as_posix()}")
    return StreamingResponse(
        packed,
        media_type="application/zip",
        headers={
            "Content-Length": str(len(packed)),
            "Content-Disposition": f'attachment; filename="{session_id}.zip"',
            "Cache-Control": "no-store",
        },
    )


@router.get(
    "/v1/sessions/{session_id}/log",
    response_class=PlainTextResponse,
    responses={**stored_files.binary("text/plain", description="The lines"), **problems.NOT_FOUND},
)
def log(service: ServiceOf, session_id: SessionId) -> PlainTextResponse:
    """Returns the session's log as text: one line for each event, and for each action with its actor."""
    service.store.journal.session(session_id)
    lines = [f"{entry['at']}  {entry['what']:<20} {_facts(entry)}".rstrip() for entry in _entries(service, session_id)]
    return PlainTextResponse("\n".join([*lines, ""]))


def _entries(service: Service, session_id: str) -> list[dict[str, Any]]:
    """Returns events and actions in chronological order."""
    journal = service.store.journal
    entries = [
        {"at": as_datetime(event.at).isoformat(), "what": event.type, **event.body}
        for event in _events(service, session_id)
    ]
    entries += [
        {"at": as_datetime(item.at).isoformat(), "what": "action", "action": item.action, "by": item.actor,
         "outcome": item.outcome}
        for item in journal.actions(session_id)
    ]  # fmt: skip
    return sorted(entries, key=lambda entry: str(entry["at"]))


def _events(service: Service, session_id: str) -> Iterator[Event]:
    last = 0
    while batch := service.store.journal.events(last, EVENTS_PER_QUERY, session_id):
        yield from batch
        last = batch[-1].id


def _facts(entry: dict[str, Any]) -> str:
    return " ".join(
        f"{name}={_fact(value)}" for name, value in entry.items() if name not in ("at", "what") and value is not None
    )


def _fact(value: Any) -> str:
    """Formats a value so that it can forge neither a line nor another fact. Text in any language stays readable."""
    if isinstance(value, str) and _PLAIN.fullmatch(value):
        return value
    text = json.dumps(value, ensure_ascii=False)
    return "".join(one if one.isprintable() else json.dumps(one)[1:-1] for one in text)


def _is_exportable(path: Path, folder: Path) -> bool:
    """Returns whether a file is completely written (neither hidden nor `.part`) and no symbolic link."""
    parts = path.relative_to(folder).parts
    hidden = any(part.startswith(".") or part.endswith(".part") for part in parts)
    return path.is_file() and not path.is_symlink() and not hidden
