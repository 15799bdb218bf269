"""What the service answers, as values or as a `ProblemError`; both clients read it by these functions."""

from collections.abc import Mapping
from typing import Any, NoReturn, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from acquisition.models.errors import ErrorCode
from acquisition.session import State
from api.rest.schemas import Problem, SessionResource

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


def completed(session: SessionResource) -> SessionResource:
    """The session, if it is complete. Raises ProblemError with its reason."""
    if session.state is State.COMPLETED:
        return session
    detail = f"Session {session.id} is {session.state}"
    raise ProblemError(session.reason or Problem.of(ErrorCode.SESSION_STEP_FAILED, detail))


def parsed(answer: httpx.Response, model: type[ModelT]) -> ModelT:
    """The body of an answer as a value."""
    return model.model_validate_json(answer.content)


def raise_problem(answer: httpx.Response) -> NoReturn:
    """Raises the problem in an answer as ProblemError."""
    try:
        problem = Problem.model_validate_json(answer.content)
    except ValidationError:
        detail = f"{answer.url} answered {answer.status_code}, not as this service does: {answer.text[:200]!r}"
        problem = Problem.of(ErrorCode.SERVICE_FAULT, detail)
    raise ProblemError(problem)
