"""Hooks that schemathesis loads: requests lead somewhere half of the time, and every answer is noted.

Loaded by `SCHEMATHESIS_HOOKS`. `CONTRACT_KNOWN` is a JSON object of path parameters that exist; `CONTRACT_NOTES` the
file for one JSON object per request that is sent, and one per answer or request without one. On SIGUSR1 the stacks of
all threads are written to standard error.
"""

import faulthandler
import json
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import schemathesis
from schemathesis.generation.meta import TestPhase

from tests.contract.steering import Steering, ending

KNOWN: dict[str, Any] = json.loads(os.environ["CONTRACT_KNOWN"])
NOTES = Path(os.environ["CONTRACT_NOTES"])

_steering = Steering(KNOWN)
_writing = threading.Lock()

faulthandler.register(signal.SIGUSR1, all_threads=True)


def _note(case: Any, **facts: Any) -> None:
    facts = {"thread": threading.get_ident(), "phase": _phase(case), "method": case.method.upper(), **facts}
    with _writing, NOTES.open("a", encoding="utf-8") as file:
        file.write(json.dumps({**facts, "path": case.operation.path}) + "\n")


def _phase(case: Any) -> str:
    meta = case.meta
    return "stateful" if meta is None else TestPhase(meta.phase.name).value


@schemathesis.hook
def map_path_parameters(context: Any, path_parameters: dict[str, Any] | None) -> dict[str, Any] | None:
    """Half of what is sent as described names things that exist; none of those is deleted."""
    return _steering.path_parameters(context, path_parameters)


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: dict[str, Any]) -> None:
    """Events are read until now; what is known to exist is not deleted. Notes the request, which is sent next."""
    del context, kwargs
    if case.method.upper() == "DELETE" and (case.path_parameters or {}).get("session_id") == KNOWN["session_id"]:
        case.path_parameters["session_id"] = "kept"
    case.query = ending(case.operation.path, case.method, case.query)
    _note(case, sent=time.time())


@schemathesis.hook
def after_call(context: Any, case: Any, response: Any) -> None:
    """Notes an answer."""
    del context
    code = None
    if response.status_code >= 400 and response.headers.get("content-type", [""])[0].startswith("application/problem"):
        code = json.loads(response.content)["code"]
    _note(
        case,
        status=response.status_code,
        code=code,
        seconds=response.elapsed,
        retry_after=response.headers.get("retry-after", [None])[0],
    )


@schemathesis.hook
def after_network_error(context: Any, case: Any, request: Any) -> None:
    """Notes a request without an answer: a hang, or a connection that was cut."""
    del context, request
    _note(case, status=None)
