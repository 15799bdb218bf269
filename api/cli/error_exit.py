"""The end of a command that failed: the problem, what to do about it, and exit status 2."""

import sys
from collections.abc import Callable
from typing import NoReturn, TypeVar

import typer

from acquisition.models.errors import PROBLEMS, ErrorCode, RigError

T = TypeVar("T")


def explain_errors(work: Callable[[], T]) -> T:
    """Runs a command; prints a RigError or ProblemError with its remedy and exits with status 2."""
    from api import ProblemError

    try:
        return work()
    except RigError as error:
        _exit_with_remedy(error.code, error.detail)
    except ProblemError as error:
        _exit_with_remedy(error.code, error.detail)


def _exit_with_remedy(code: ErrorCode, detail: str) -> NoReturn:
    print(f"{code}: {detail}", file=sys.stderr)
    print(f"  What to do: {PROBLEMS[code].remedy}", file=sys.stderr)
    raise typer.Exit(2)
