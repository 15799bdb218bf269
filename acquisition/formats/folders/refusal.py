"""How readers refuse: one sentence that names the file and what to do."""

from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError


def refusal(path: Path, detail: str) -> RigError:
    """The error of one file in a capture folder."""
    return RigError(ErrorCode.FOLDER_INVALID, f"{path}: {detail}", file=str(path))


def text(path: Path) -> str:
    """A small text file, byte order mark or not. Raises RigError folder.invalid when it is missing or no text."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise refusal(path, "is missing: put it there") from error
    except (OSError, UnicodeDecodeError) as error:
        raise refusal(path, f"cannot be read: {error}") from error
