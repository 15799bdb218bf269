"""Errors of readers: one sentence that names the file and the remedy."""

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from acquisition.models.base import Value
from acquisition.models.errors import ErrorCode, RigError, in_words

ValueT = TypeVar("ValueT", bound=Value)


def refusal(path: Path, detail: str) -> RigError:
    """Returns the error of one file in a capture folder."""
    return RigError(ErrorCode.FOLDER_INVALID, f"{path}: {detail}", file=str(path))


def content(path: Path) -> bytes:
    """Reads the bytes of a file. Raises RigError folder.invalid when it is missing or cannot be read."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise refusal(path, "is missing: add it") from error
    except OSError as error:
        raise refusal(path, f"cannot be read: {error}") from error


def text(path: Path) -> str:
    """Reads a small text file, with or without a byte order mark. Raises RigError folder.invalid if it is not one."""
    try:
        return content(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refusal(path, f"is not text in UTF-8 (byte {error.start + 1}): save it as UTF-8") from error


def value(path: Path, kind: type[ValueT]) -> ValueT:
    """Reads a value from its JSON file. Raises RigError folder.invalid naming the field that is wrong."""
    try:
        return kind.model_validate_json(text(path))
    except ValidationError as error:
        worst = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in worst["loc"]) or "the file"
        raise refusal(
            path, f"{field}: {in_words(worst)} ({error.error_count()} error(s) in all): correct it"
        ) from error
