"""Problem objects (`application/problem+json`, RFC 9457) for every error, from the one table of codes.

The `type` of a problem is the address of a page of this service that explains the code: a client switches on `code`,
and a person follows the link. An unexpected exception is logged with its traceback. The answer contains none of it,
because a traceback may hold what the caller must not see.
"""

import logging
from collections.abc import Mapping, Sequence
from html import escape
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, FastAPI, Path, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, Response
from starlette.exceptions import HTTPException

from acquisition.models.calibration_recipe import TAGS
from acquisition.models.errors import ErrorCode, Halted, RigError, in_words
from acquisition.models.problem_table import PROBLEMS
from api.rest.schemas import FieldError, Problem, ProblemPage

MEDIA_TYPE = "application/problem+json"

MAX_INSTANCE_LENGTH = 300
"""Number of characters of the requested address that a problem repeats."""

RETRY_AFTER_S = 5
"""Time after which to repeat a request that found a device absent, s; the service retries the device within it."""

_PASSES = frozenset({HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.SERVICE_UNAVAILABLE})
_log = logging.getLogger(__name__)
_CODE_OF_STATUS = {
    404: ErrorCode.REQUEST_NOT_FOUND,
    405: ErrorCode.REQUEST_METHOD_NOT_ALLOWED,
    413: ErrorCode.REQUEST_TOO_LARGE,
    415: ErrorCode.REQUEST_MEDIA_TYPE,
}


def response(
    code: ErrorCode,
    detail: str,
    context: Mapping[str, Any] | None = None,
    instance: str | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """Builds the HTTP response of a problem: its status, its media type, and the problem object as the body.

    Every 429 and 503 has a Retry-After header: `retry_after_s` of the context, else `RETRY_AFTER_S`.
    """
    problem = Problem.of(code, detail, context, instance and instance[:MAX_INSTANCE_LENGTH])
    retry = {}
    if problem.status in _PASSES:
        retry = {"Retry-After": str((context or {}).get("retry_after_s", RETRY_AFTER_S))}
    return JSONResponse(
        problem.model_dump(mode="json"),
        status_code=problem.status,
        media_type=MEDIA_TYPE,
        headers={**retry, **(headers or {})},
    )


def with_status(status: int, code: ErrorCode, detail: str, instance: str | None = None) -> JSONResponse:
    """Builds the HTTP response of a problem with an HTTP status other than that of its code."""
    problem = Problem.of(code, detail, None, instance and instance[:MAX_INSTANCE_LENGTH])
    body = problem.model_copy(update={"status": status}).model_dump(mode="json")
    return JSONResponse(body, status_code=status, media_type=MEDIA_TYPE)


def _declaration(description: str) -> dict[str, Any]:
    schema = {"$ref": "#/components/schemas/Problem"}
    return {"description": description, "content": {MEDIA_TYPE: {"schema": schema}}}


def responses_of(*codes: ErrorCode) -> dict[int | str, dict[str, Any]]:
    """Returns the OpenAPI responses of the problems that a route may answer, by HTTP status."""
    by_status: dict[int | str, list[ErrorCode]] = {}
    for code in codes:
        by_status.setdefault(PROBLEMS[code].status, []).append(code)
    return {status: _declaration(" or ".join(f"`{code}`" for code in codes)) for status, codes in by_status.items()}


def default_response() -> dict[int | str, dict[str, Any]]:
    """Returns the OpenAPI response of every route for any other problem, which has the same schema."""
    return {"default": _declaration("any other problem; `code` says which")}


BODY_CODES = (ErrorCode.REQUEST_INVALID, ErrorCode.REQUEST_TOO_LARGE, ErrorCode.REQUEST_MEDIA_TYPE)
"""Problems of every route that has a body."""

NOT_FOUND = responses_of(ErrorCode.SESSION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND)
"""Responses of a route about a part of a session."""


def install(app: FastAPI) -> None:
    """Registers the exception handlers that answer every error as a problem object."""
    app.add_exception_handler(RigError, _rig_error)
    app.add_exception_handler(Halted, _halted)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(Exception, _fault)


router = APIRouter(tags=["problems"])


@router.get(
    "/problems/{code}",
    response_model=ProblemPage,
    responses={
        200: {"description": "Meaning and remedy", "content": {"text/html": {"schema": {"type": "string"}}}},
        **responses_of(ErrorCode.REQUEST_NOT_FOUND),
    },
)
async def problem_page(
    request: Request, code: Annotated[str, Path(max_length=80, description="A code, such as `rig.busy`")]
) -> Response:
    """Returns the meaning and the remedy of a problem code: a page for a browser, JSON for a program."""
    known = next((item for item in ErrorCode if item == code), None)
    if known is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, "There is no such problem code", known=list(ErrorCode))
    problem = PROBLEMS[known]
    if "text/html" not in request.headers.get("accept", ""):
        page = ProblemPage(code=known, status=problem.status, title=problem.title, remedy=problem.remedy)
        return JSONResponse(page.model_dump(mode="json"))
    return HTMLResponse(
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(problem.title)}</title>"
        "<body style='font:16px/1.5 sans-serif;max-width:40em;margin:3em auto'>"
        f"<h1>{escape(problem.title)}</h1><p><code>{known}</code> · HTTP {problem.status}</p>"
        f"<h2>What to do</h2><p>{escape(problem.remedy)}</p></body></html>"
    )


# ----------------------------------------------------------------------------------------------------------- handlers


async def _rig_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RigError)  # noqa: S101 - registered for this type
    if PROBLEMS[error.code].status == HTTPStatus.INTERNAL_SERVER_ERROR:
        _log.error("%s %s: %s", request.method, request.url.path, error)
    return response(error.code, error.detail, error.context, request.url.path)


async def _halted(request: Request, error: Exception) -> Response:
    # Only the end of the service halts what a request waits for.
    return response(ErrorCode.RIG_NOT_READY, "The service is ending", None, request.url.path)


async def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - registered for this type
    errors = [FieldError(field=_field(item["loc"]), message=in_words(item)) for item in error.errors()]
    detail = "; ".join(f"{item.field}: {item.message}" for item in errors[:5])
    return response(ErrorCode.REQUEST_INVALID, detail, {"errors": errors}, request.url.path)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - registered for this type
    code = _CODE_OF_STATUS.get(error.status_code)
    if code is None:
        code = ErrorCode.REQUEST_INVALID if error.status_code < 500 else ErrorCode.SERVICE_FAULT
    detail = f"{request.method} {request.url.path[:200]}: {error.detail}"
    return response(code, detail, None, request.url.path, error.headers)


async def _fault(request: Request, error: Exception) -> Response:
    # The server logs the exception with its trace after this answer is sent.
    return response(ErrorCode.SERVICE_FAULT, "An unexpected error; its traceback is in the log", None, request.url.path)


def _field(location: Sequence[str | int]) -> str:
    """Returns the dotted name of a field as the caller wrote it, without the leading part (body, query)."""
    location = [part for part in location if part not in TAGS]
    return ".".join(str(part) for part in (location[1:] if len(location) > 1 else location))
