"""Manifests of the archive: what a session and a result consist of, by path and SHA-256.

A session's key is the hash of its id and files: captures of two cells with the same id have two keys, and a session
that is pushed twice has one. Results are entries of their own, because they are added as long as the archive exists.
`results/` and what a person may still change (label, notes) are no part of the key.
"""

import hashlib
import json
import math
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from packaging.version import InvalidVersion, Version
from pydantic import AfterValidator, Field

from acquisition.models.base import Value
from acquisition.models.result import SolveSettings

SESSIONS = "sessions"
_DIGITS = 6
"""Digits of each number of a version in its sort key."""


def _inside(path: str) -> str:
    """Refuses a path that leaves the folder that files are fetched into: several cells write one archive's entries."""
    place = PurePosixPath(path)
    if not place.parts or place.is_absolute() or ".." in place.parts:
        raise ValueError(f"{path!r} is no path within a folder")
    return path


def _version(text: str) -> str:
    version_order(text)
    return text


RelativePath = Annotated[str, AfterValidator(_inside)]


class FileEntry(Value):
    """One file by its content."""

    sha256: str = Field(pattern="^[0-9a-f]{64}$")
    bytes: int = Field(ge=0)


class SessionFacts(Value):
    """What the catalogue states of a session, from its own files; a person may have changed object and notes."""

    session_id: str
    object: str = Field(description="The session's label")
    notes: str
    cell: str = Field(description="Name in the cell file")
    kind: str = Field(description="Kind of recipe: capture, camera, hand-eye, lamp, response, …")
    method: str | None = Field(description="How lights were chosen; none: a calibration session")
    lights: int
    width: int
    height: int
    captured_at: float | None = Field(description="Time of the first image, s since 1970; none: no image")
    calibration: str = Field(description="Fingerprint of the calibration in use")
    software: str = Field(description="Version that captured it")


class SessionEntry(Value):
    """One session of the archive, without its results."""

    format: Literal[1] = 1
    facts: SessionFacts
    files: dict[RelativePath, FileEntry]

    @property
    def key(self) -> str:
        """Identity of the session: SHA-256 of its id and of its files' paths and contents."""
        files = {path: file.sha256 for path, file in self.files.items()}
        return hash_of({"session_id": self.facts.session_id, "files": files})

    @property
    def name(self) -> str:
        """Name of the entry's file in the archive."""
        return session_name(self.key)

    @property
    def bytes(self) -> int:
        """Size of all files."""
        return sum(file.bytes for file in self.files.values())


class SolveIdentity(Value):
    """What distinguishes the solves of a session by the same version of the solver."""

    settings: SolveSettings = SolveSettings()
    last_pass: int | None = Field(default=None, description="Last pass whose images are used; none: all passes")
    calibration: str | None = Field(default=None, description="Calibration in place of the session's own; none: that")

    @property
    def hash(self) -> str:
        """The settings' hash in the catalogue, 16 hexadecimal digits."""
        return hash_of(self.model_dump(mode="json"))[:16]


class ResultEntry(Value):
    """One result: its session, solver, settings, files and figures."""

    format: Literal[1] = 1
    session: str
    solver: Annotated[str, AfterValidator(_version)] = Field(description="Version of lightpose that solved it")
    identity: SolveIdentity
    origin: Literal["cell", "archive"]
    sigma_deg: float | None
    solved_at: float = Field(description="s since 1970")
    files: dict[RelativePath, FileEntry]

    @property
    def name(self) -> str:
        """Name of the entry's file in the archive."""
        return result_name(self.session, self.solver, self.identity.hash)

    @property
    def age(self) -> tuple[float, float, str]:
        """Sort key of the results of one session.

        Results in copied folders can have equal times; of these, the one of fewer passes comes first.
        """
        last = self.identity.last_pass
        return self.solved_at, math.inf if last is None else last, self.name


def session_name(key: str) -> str:
    """Name of a session's entry in the archive."""
    return f"{SESSIONS}/{key}/session.json"


def result_name(key: str, solver: str, settings: str) -> str:
    """Name of a result's entry in the archive."""
    return f"{SESSIONS}/{key}/results/{solver}-{settings}.json"


def hash_of(value: Any) -> str:
    """Returns the SHA-256 of a value's canonical JSON (keys sorted, no white space)."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def version_order(version: str) -> str:
    """Returns a version as text that sorts as versions do (PEP 440): 0.9 before 0.10, pre-release before release.

    Raises ValueError if `version` is no version.
    """
    try:
        parsed = Version(version)
    except InvalidVersion as error:
        raise ValueError(f"{version!r} is not a version, such as 0.2 or 1.0.3") from error
    release = [*parsed.release, 0, 0, 0, 0][: max(4, len(parsed.release))]
    numbers = ".".join(f"{number:0{_DIGITS}d}" for number in release)
    # A development release without a phase sorts before all others of its number; one without `dev` after those with.
    development_only = parsed.dev is not None and parsed.pre is None and parsed.post is None
    phase = "0" if development_only else f"1{parsed.pre[0]}{parsed.pre[1]:0{_DIGITS}d}" if parsed.pre else "2"
    post = 0 if parsed.post is None else parsed.post + 1
    dev = "~" if parsed.dev is None else f"{parsed.dev:0{_DIGITS}d}"
    return f"{numbers}-{phase}-{post:0{_DIGITS}d}-{dev}"
