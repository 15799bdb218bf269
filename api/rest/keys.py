"""API keys: who may do what, and the file that holds them.

A key is 256 random bits, so its SHA-256 needs no salt and no slow hash: nobody guesses it, and whoever steals the file
cannot turn a hash back. The hashes of a running service live in memory, where a stop finds them without touching the
disk; a thread takes over what the command line changes, and a file that vanishes or breaks shuts everybody out rather
than letting everybody in.
"""

import hashlib
import hmac
import json
import logging
import os
import secrets
import threading
import time
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from acquisition.models.errors import ErrorCode, RigError

PREFIX = "lightpose_"
"""Lets people and secret scanners see what leaked."""

LOOK_AGAIN_S = 1.0
TICKET_S = 300.0
MOST_TICKETS = 10_000

_log = logging.getLogger(__name__)


class Role(StrEnum):
    """What a key may do; each role may do what those before it may. Every key may stop."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ADMIN = "admin"

    def covers(self, needed: "Role") -> bool:
        """Whether this role may do what `needed` may."""
        order = list(Role)
        return order.index(self) >= order.index(needed)


@dataclass(frozen=True)
class Caller:
    """Who asks, for the record, and as what."""

    name: str
    role: Role


class Key(BaseModel):
    """One key as it is kept: never the secret."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9._-]+$")]
    role: Role
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    created_at: float


class KeyFile(BaseModel):
    """The whole file `keys.json`, readable by its owner alone."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    keys: tuple[Key, ...] = ()


def path_in(data: Path) -> Path:
    """Where a data folder keeps its keys."""
    return data / "keys.json"


def read(path: Path) -> KeyFile | None:
    """The key file, None where there is none. Raises RigError config.invalid for one that cannot be read."""
    try:
        return KeyFile.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path.name} cannot be read: {error}", file=path.name) from error


def add(path: Path, name: str, role: Role) -> str:
    """Makes a key and returns its secret, which is shown this once. Raises RigError config.invalid for a name taken."""
    known = read(path) or KeyFile()
    if any(key.name == name for key in known.keys):
        raise RigError(ErrorCode.CONFIG_INVALID, f"There is a key named {name!r}: revoke it first, or choose a name")
    secret = PREFIX + secrets.token_urlsafe(32)
    try:
        key = Key(name=name, role=role, sha256=_digest(secret), created_at=time.time())
    except ValidationError as error:
        raise RigError(
            ErrorCode.CONFIG_INVALID, f"{name!r} is no name for a key: use letters, digits, dot, dash, underscore"
        ) from error
    _write(path, KeyFile(keys=(*known.keys, key)))
    return secret


def revoke(path: Path, name: str) -> None:
    """Removes a key; a running service refuses it within a second. Raises RigError config.invalid if there is none."""
    known = read(path) or KeyFile()
    left = tuple(key for key in known.keys if key.name != name)
    if len(left) == len(known.keys):
        names = ", ".join(key.name for key in known.keys) or "none"
        raise RigError(ErrorCode.CONFIG_INVALID, f"There is no key named {name!r}; there are: {names}")
    _write(path, KeyFile(keys=left))


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()


def _write(path: Path, content: KeyFile) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(".part")
    beside.unlink(missing_ok=True)
    with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        json.dump(content.model_dump(mode="json"), file, indent=2)
        file.flush()
        os.fsync(file.fileno())
    beside.rename(path)


class KeyRing:
    """The keys of a running service, and the tickets that they have given out.

    `required` is set for good once there has been a key: taking the last one away opens nothing. Raises RigError
    config.invalid when the file cannot be read at the start.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        content = read(path)
        self._keys: tuple[Key, ...] = () if content is None else content.keys
        self.required = content is not None
        self._seen = self._stamp()
        self._tickets: dict[str, tuple[float, Caller]] = {}
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="keys", daemon=True)

    def open(self) -> None:
        """Begins to follow the file."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()

    def caller(self, secret: str) -> Caller | None:
        """Whose key this is; takes as long for a wrong key as for a right one."""
        digest = _digest(secret)
        found: Caller | None = None
        for key in self._keys:
            if hmac.compare_digest(key.sha256, digest):
                found = Caller(key.name, key.role)
        return found

    def issue_ticket(self, caller: Caller, now: float) -> str:
        """A ticket with which a page may look, and only look, until `now` (s, monotonic) + TICKET_S."""
        while self._tickets:  # the oldest stands first and ends first
            oldest = next(iter(self._tickets))
            if self._tickets[oldest][0] >= now and len(self._tickets) < MOST_TICKETS:
                break
            del self._tickets[oldest]
        ticket = secrets.token_urlsafe(32)
        self._tickets[ticket] = (now + TICKET_S, Caller(caller.name, Role.VIEWER))
        return ticket

    def holder(self, ticket: str, now: float) -> Caller | None:
        """Who holds a ticket that is still good at `now` (s, monotonic), if its key is."""
        until, caller = self._tickets.get(ticket, (0.0, None))
        if caller is None or until < now or (self.required and caller.name not in {key.name for key in self._keys}):
            return None
        return caller

    def _watch(self) -> None:
        while not self._ending.wait(LOOK_AGAIN_S):
            stamp = self._stamp()
            if stamp != self._seen:
                self._seen = stamp
                self._take_over()

    def _take_over(self) -> None:
        try:
            content = read(self._path)
        except RigError as error:
            _log.error("no key is accepted: %s", error)
            content = None
        self._keys = () if content is None else content.keys
        self.required = self.required or content is not None
        _log.info("keys: %s", ", ".join(f"{key.name} ({key.role})" for key in self._keys) or "none")

    def _stamp(self) -> tuple[int, int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_ino, found.st_size
