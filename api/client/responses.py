"""Parsing of the service's answers into values or a `ProblemError`; shared by both clients."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NoReturn, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from acquisition.models.errors import ErrorCode
from acquisition.session_state import State
from api.rest.rig_schemas import RigResource
from api.rest.schemas import EventResource, Problem, SessionResource

ModelT = TypeVar("ModelT", bound=BaseModel)


class ProblemError(Exception):
    """The service refused, or a session did not complete: a code for programs, a sentence, and what to do."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(f"{problem.code}: {problem.detail}. {problem.remedy}")
        self.problem = problem

    @property
    def code(self) -> ErrorCode:
        """The code, such as `rig.busy`."""
        return self.problem.code

    @property
    def detail(self) -> str:
        """What happened in this case."""
        return self.problem.detail

    @property
    def remedy(self) -> str:
        """What to do."""
        return self.problem.remedy

    @property
    def context(self) -> Mapping[str, Any]:
        """Further facts, such as `allowed`, `holder` or `errors`."""
        return self.problem.model_extra or {}


def require_completed(session: SessionResource, events: Sequence[EventResource]) -> SessionResource:
    """Returns a completed session. Raises ProblemError if it is in any other state: with the session's reason, or
    session.stopped with what its `events` say of the stop."""
    if session.state is State.COMPLETED:
        return session
    if session.state is State.STOPPED:
        raise ProblemError(Problem.of(ErrorCode.SESSION_STOPPED, _stop(session.id, events)))
    detail = f"Session {session.id} is {session.state}"
    raise ProblemError(session.reason or Problem.of(ErrorCode.SESSION_STEP_FAILED, detail))


def _stop(session_id: str, events: Sequence[EventResource]) -> str:
    """Tells who stopped a session, and for what it was suspended then."""
    states = [event.body for event in events if event.type == "session.state"]
    for before, after in reversed(list(pairwise([dict[str, Any](), *states]))):
        if after["state"] in (State.STOPPING, State.STOPPED) and before.get("state") != State.STOPPING:
            reason = before.get("reason")
            suspended = "" if reason is None else f", which was {before['state']}: {reason['code']}: {reason['detail']}"
            return f"{after['by']} stopped session {session_id}{suspended}"
    return f"Session {session_id} is stopped"


def not_ready(rig: RigResource) -> Problem:
    """Returns the problem of a rig on which no session may start: its reasons, each with what to do."""
    detail = " ".join(f"{item.detail}. {item.remedy}" for item in rig.reasons)
    reasons = [item.model_dump(mode="json") for item in rig.reasons]
    return Problem.of(ErrorCode.RIG_NOT_READY, detail.removesuffix("."), {"reasons": reasons})


def unreachable(error: httpx.TransportError) -> Problem:
    """Returns the problem of a service that does not answer. Raises the error of an address that none can have."""
    if isinstance(error, httpx.UnsupportedProtocol):
        raise error
    url, why = error.request.url, str(error) or type(error).__name__
    return Problem.of(ErrorCode.SERVICE_UNREACHABLE, f"{url.scheme}://{url.netloc.decode()} does not answer: {why}")


def parsed(response: httpx.Response, model: type[ModelT]) -> ModelT:
    """Parses the body of an answer into a value. Raises ValidationError if it does not fit the model."""
    return model.model_validate_json(response.content)


def raise_problem(response: httpx.Response) -> NoReturn:
    """Raises an answer's problem object as ProblemError; a body of another kind becomes service.fault."""
    try:
        problem = Problem.model_validate_json(response.content)
    except ValidationError:
        detail = f"{response.url} answered {response.status_code} with an unexpected body: {response.text[:200]!r}"
        problem = Problem.of(ErrorCode.SERVICE_FAULT, detail)
    raise ProblemError(problem)
