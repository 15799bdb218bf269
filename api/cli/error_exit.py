"""The end of a failed command: the problem, its remedy, and exit status 2."""

import sys
from collections.abc import Callable
from typing import NoReturn, TypeVar

import typer

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import PROBLEMS
from api.cli.named_paths import is_named

T = TypeVar("T")

REMEDIES = {
    ErrorCode.CONFIG_INVALID: "Correct what the message names, and run the command again; `lightpose check` tests "
    "a cell file.",
    ErrorCode.REQUEST_NOT_FOUND: "Correct the name or the folder that the message names, and run the command again.",
    ErrorCode.REQUEST_INVALID: "Correct the option or the file that the message names, and run the command again.",
    ErrorCode.FOLDER_INVALID: "Correct what the message names, and run the command again; nothing has been written.",
    ErrorCode.DEVICE_DISCONNECTED: "Check that the device, or the simulated cell (`lightpose sim`), runs there.",
    ErrorCode.STORE_DISK_FULL: "Free space there, or use a folder on another disk, and run the command again.",
}
"""Remedies of errors in a command itself, where those of the table suit only a service."""

SERVICE_REMEDY = (
    "Start it there with `lightpose serve`, or correct the address. A session that has begun at the service goes on."
)


def explain_errors(work: Callable[[], T]) -> T:
    """Runs a command; prints a RigError or ProblemError with its remedy and exits with status 2.

    So it does if a service does not answer, or a file that the command line names cannot be read or written. Any other
    error of a file is a defect of the program, whose traceback is needed.
    """
    import httpx

    from api import ProblemError

    try:
        return work()
    except RigError as error:
        _exit_with_remedy(error.code, error.detail, REMEDIES.get(error.code, PROBLEMS[error.code].remedy))
    except ProblemError as error:
        _exit_with_remedy(error.code, error.detail, PROBLEMS[error.code].remedy)
    except (httpx.UnsupportedProtocol, httpx.InvalidURL) as error:
        detail = f"the service's address is not valid: {error}"
        _exit_with_remedy(ErrorCode.REQUEST_INVALID, detail, "Give it in full, such as http://127.0.0.1:8000.")
    except httpx.TransportError as error:
        url = error.request.url
        detail = f"the service at {url.scheme}://{url.netloc.decode()} does not answer: {error or type(error).__name__}"
        _exit_with_remedy(ErrorCode.REQUEST_INVALID, detail, SERVICE_REMEDY)
    except OSError as error:
        if not isinstance(error.filename, str) or not is_named(error.filename):
            raise
        detail = f"{error.filename}: cannot be read or written: {error.strerror}"
        _exit_with_remedy(ErrorCode.REQUEST_INVALID, detail, REMEDIES[ErrorCode.REQUEST_INVALID])


def _exit_with_remedy(code: ErrorCode, detail: str, remedy: str) -> NoReturn:
    print(f"{code}: {detail}", file=sys.stderr)
    print(f"  What to do: {remedy}", file=sys.stderr)
    raise typer.Exit(2)
