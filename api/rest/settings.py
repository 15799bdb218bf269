"""Settings of the service process: host, port, data folder, cell file, allowed web pages.

The cell file describes the cell. The environment (`LIGHTPOSE_…`) and the command line hold only what depends on the
machine, so that one cell file works on every machine.
"""

import ipaddress
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, ValidationError, field_validator
from pydantic_core import ErrorDetails
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from acquisition.models.errors import ErrorCode, RigError, in_words
from api.rest.logs import LogFormat
from api.rest.trusted_proxies import TrustedProxies

Names = Annotated[tuple[str, ...], NoDecode]


class ServerSettings(BaseSettings):
    """Settings of every server of this package: where it listens, and who may call."""

    model_config = SettingsConfigDict(env_prefix="LIGHTPOSE_", frozen=True, extra="forbid")

    data: Path = Field(Path("data"), description="Folder of journal and sessions, and of the keys")
    host: str = Field("127.0.0.1", min_length=1)
    port: int = Field(8000, ge=0, le=65535, description="0: any free port")
    log: LogFormat = Field("text", description="`json`: one object a line")
    log_file: Path | None = Field(None, description="File of the log, which rotates; none: standard error")
    allowed_hosts: Names = Field((), description="Further names accepted in the Host header, comma-separated")
    allowed_origins: Names = Field((), description="Web pages that may call, as scheme://host:port, comma-separated")

    trusted_proxies: Names = Field((), description="Addresses of proxies whose X-Forwarded-… counts, comma-separated")

    tls_cert: Path | None = Field(None, description="Certificate (PEM, with intermediate ones), to serve HTTPS")
    tls_key: Path | None = Field(None, description="The certificate's private key (PEM), that not everybody may read")

    @field_validator("allowed_hosts", "allowed_origins", "trusted_proxies", mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        if isinstance(value, str):
            return tuple(item.strip().rstrip("/").lower() for item in value.split(",") if item.strip())
        return value

    @field_validator("trusted_proxies")
    @classmethod
    def _addresses(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        TrustedProxies(value)
        return value


class Settings(ServerSettings):
    """Settings of the service, from the environment. Keyword arguments take precedence."""

    cell: Path = Field(description="The cell file")
    archive: str | None = Field(
        None, min_length=1, description="Archive to which ended sessions are sent: folder or s3://…"
    )
    archive_catalogue: str | None = Field(None, min_length=1, description="Its catalogue; none: SQLite in the folder")

    @field_validator("archive")
    @classmethod
    def _absolute(cls, value: str | None) -> str | None:
        """`lightpose prune`, which asks the archive for what it has, runs in another folder than the service."""
        if value is None or ":" in value or value.startswith("~"):
            return value
        return str(Path(value).absolute())


SettingsT = TypeVar("SettingsT", bound=ServerSettings)


def read(**values: Any) -> Settings:
    """Reads the settings of this process. Raises RigError config.invalid naming each bad variable."""
    return read_as(Settings, **values)


def read_as(kind: type[SettingsT], **values: Any) -> SettingsT:
    """Reads settings of a class. Raises RigError config.invalid naming each bad variable."""
    try:
        return kind(**values)
    except ValidationError as error:
        fields = "; ".join(
            f"LIGHTPOSE_{'_'.join(map(str, item['loc'])).upper()}: {_wrong(item)}" for item in error.errors()
        )
        raise RigError(ErrorCode.CONFIG_INVALID, fields) from error


def _wrong(item: ErrorDetails) -> str:
    if item["type"] != "missing":
        return in_words(item)
    name = "-".join(map(str, item["loc"])).replace("_", "-")
    return f"is not set: set it, or give --{name}"


def refuse_open_bind(host: str, keys: bool, what: str = "move the arm", role: str = "operator") -> None:
    """Refuses a host other than loopback without keys. Raises RigError config.invalid with `what` anybody could do."""
    if not keys and not is_loopback(host):
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"The service does not listen on {host!r} without keys: anybody who reaches it could {what}. Make a key "
            f"with `lightpose keys add NAME --role {role} --data FOLDER`, or listen on 127.0.0.1 and reach it from "
            "elsewhere by an SSH tunnel (ssh -L 8000:127.0.0.1:8000 …).",
            host=host,
        )


def is_loopback(host: str) -> bool:
    """Returns whether a host is `localhost` or a loopback address."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
