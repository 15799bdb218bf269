"""API keys, their roles, the file that stores them, and short-lived tickets.

A key has 256 random bits. It cannot be guessed, and its hash cannot be inverted, so its SHA-256 needs neither salt nor
a slow hash function. A running service keeps the hashes in memory, where a stop checks them without touching the disk.
A thread reloads the file when the command line changes it. If the file vanishes or is damaged, nobody is admitted.
"""

import hashlib
import hmac
import json
import logging
import math
import os
import secrets
import stat
import threading
import time
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from acquisition.formats.atomic_write import publish
from acquisition.formats.session_files import refuse_as_data
from acquisition.models.errors import ErrorCode, RigError

PREFIX = "lightpose_"
"""Prefix of every key, by which people and secret scanners recognise a leaked one."""

POLL_S = 1.0
"""Time between two checks of the key file, s."""

OF_OTHERS = 0o077
"""Permission bits of a file for users other than its owner."""

TICKET_LIFETIME_S = 300.0
"""Validity of a ticket, s."""

MAX_TICKETS = 10_000
"""Maximum number of valid tickets; bounds the memory."""

_log = logging.getLogger(__name__)


class Role(StrEnum):
    """Role of a key. Each role includes the permissions of those before it. Every key may stop the cell."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ADMIN = "admin"

    def covers(self, needed: "Role") -> bool:
        """Returns whether this role includes the permissions of `needed`."""
        order = list(Role)
        return order.index(self) >= order.index(needed)


@dataclass(frozen=True)
class Caller:
    """Caller of a request: name (for the record) and role, with the key's hash and the end of the ticket's validity."""

    name: str
    role: Role
    sha256: str = ""  # of the key; empty for a caller without one
    valid_until: float = math.inf  # of a ticket: s, monotonic


class Key(BaseModel):
    """One stored key: its hash, never the secret."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9._-]+$")]
    role: Role
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    created_at: float


class KeyFile(BaseModel):
    """Content of the file `keys.json`, which only its owner may read."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    keys: tuple[Key, ...] = ()


def path_in(data: Path) -> Path:
    """Path of the key file in a data folder. Raises RigError folder.invalid for a folder that a service keeps."""
    refuse_as_data(data)
    return data / "keys.json"


def read(path: Path) -> KeyFile | None:
    """Reads the key file; None without one. Raises RigError config.invalid if it is unreadable or open to others."""
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        if mode & OF_OTHERS:
            raise RigError(
                ErrorCode.CONFIG_INVALID,
                f"{path} can be read or written by others (mode {mode:04o}): run chmod 600 {path}; if that was so for "
                "long, revoke the keys and make new ones",
                file=path.name,
            )
        return KeyFile.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path.name} cannot be read: {error}", file=path.name) from error


def add(path: Path, name: str, role: Role) -> str:
    """Creates a key and returns its secret, which is not stored. Raises RigError request.invalid for a name in use."""
    known = read(path) or KeyFile()
    if any(key.name == name for key in known.keys):
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"There is a key named {name!r}: revoke it first, or choose another name"
        )
    secret = PREFIX + secrets.token_urlsafe(32)
    try:
        key = Key(name=name, role=role, sha256=_digest(secret), created_at=time.time())
    except ValidationError as error:
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"{name!r} cannot name a key: use letters, digits, dot, dash, underscore"
        ) from error
    _write(path, KeyFile(keys=(*known.keys, key)))
    return secret


def revoke(path: Path, name: str) -> None:
    """Revokes a key; a running service refuses it within a second. Raises RigError request.invalid if there is none."""
    known = read(path) or KeyFile()
    remaining = tuple(key for key in known.keys if key.name != name)
    if len(remaining) == len(known.keys):
        names = ", ".join(key.name for key in known.keys) or "none"
        raise RigError(ErrorCode.REQUEST_INVALID, f"There is no key named {name!r}; there are: {names}")
    _write(path, KeyFile(keys=remaining))


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()


def _write(path: Path, content: KeyFile) -> None:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    partial = path.with_suffix(".part")
    partial.unlink(missing_ok=True)
    with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        json.dump(content.model_dump(mode="json"), file, indent=2)
    publish(partial, path)


class KeyRing:
    """The keys of a running service, reloaded when their file changes, and the tickets issued to their holders.

    `required` stays set once there has been a key, so that revoking the last one does not open the service. Raises
    RigError config.invalid when the file cannot be read at the start.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        content = read(path)
        self._keys: tuple[Key, ...] = () if content is None else content.keys
        self.required = content is not None
        self._loaded_stamp = self._stamp()
        self._tickets: dict[str, Caller] = {}
        self._last_used: dict[str, float] = {}  # by hash: s since 1970
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="keys", daemon=True)

    def open(self) -> None:
        """Starts the thread that watches the file."""
        self._thread.start()

    def close(self) -> None:
        """Joins the thread."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def caller(self, secret: str) -> Caller | None:
        """Returns the holder of a key, None for a wrong key. Compares in constant time."""
        digest = _digest(secret)
        caller: Caller | None = None
        for key in self._keys:
            if hmac.compare_digest(key.sha256, digest):
                caller = Caller(key.name, key.role, key.sha256)
                self._last_used[key.sha256] = time.time()
        return caller

    def listed(self) -> list[tuple[Key, float | None]]:
        """Returns the keys, oldest first, each with its last use since the start (s since 1970) or None."""
        return [(key, self._last_used.get(key.sha256)) for key in self._keys]

    def issue_ticket(self, caller: Caller, now: float) -> str:
        """Issues a ticket for reading only, valid until `now` (s, monotonic) + TICKET_LIFETIME_S."""
        while self._tickets:  # in order of issue, and so of expiry
            oldest = next(iter(self._tickets))
            if self._tickets[oldest].valid_until >= now and len(self._tickets) < MAX_TICKETS:
                break
            del self._tickets[oldest]
        ticket = secrets.token_urlsafe(32)
        self._tickets[ticket] = Caller(caller.name, Role.VIEWER, caller.sha256, now + TICKET_LIFETIME_S)
        return ticket

    def holder(self, ticket: str, now: float) -> Caller | None:
        """Returns the holder of a ticket valid at `now` (s, monotonic) whose key is valid too, else None."""
        caller = self._tickets.get(ticket)
        return caller if caller is not None and self.is_valid(caller, now) else None

    def is_valid(self, caller: Caller, now: float) -> bool:
        """Returns whether a caller's key still exists and a ticket is still valid at `now` (s, monotonic)."""
        known = not self.required or any(key.sha256 == caller.sha256 for key in self._keys)
        return known and now <= caller.valid_until

    def _watch(self) -> None:
        while not self._stopping.wait(POLL_S):
            stamp = self._stamp()
            if stamp != self._loaded_stamp:
                self._loaded_stamp = stamp
                self._reload()

    def _reload(self) -> None:
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
            status = self._path.stat()
        except OSError:
            return None
        return status.st_mtime_ns, status.st_ino, status.st_size
