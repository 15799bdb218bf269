"""Where the service runs: host, port, data folder, cell file, who may call from a web page.

What the cell *is* stands in the cell file; the environment (`LIGHTPOSE_…`) and the command line say only where this
service lives, so that the same cell file serves on every machine.
"""

import ipaddress
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from acquisition.models.errors import ErrorCode, RigError
from api.rest.logs import LogForm

Names = Annotated[tuple[str, ...], NoDecode]


class Settings(BaseSettings):
    """Read from the environment; what is given by name goes before it."""

    model_config = SettingsConfigDict(env_prefix="LIGHTPOSE_", frozen=True, extra="forbid")

    cell: Path = Field(description="The cell file")
    data: Path = Field(Path("data"), description="The folder of journal and sessions")
    host: str = Field("127.0.0.1", min_length=1)
    port: int = Field(8000, ge=0, le=65535, description="0: any free port")
    log: LogForm = Field("text", description="`json`: one object a line")
    allowed_hosts: Names = Field((), description="More names in the Host header, comma-separated")
    allowed_origins: Names = Field((), description="Web pages that may call, as scheme://host:port, comma-separated")

    @field_validator("allowed_hosts", "allowed_origins", mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        if isinstance(value, str):
            return tuple(item.strip().rstrip("/").lower() for item in value.split(",") if item.strip())
        return value


def read(**given: Any) -> Settings:
    """The settings of this process. Raises RigError config.invalid naming each bad variable."""
    try:
        return Settings(**given)
    except ValidationError as error:
        fields = "; ".join(
            f"LIGHTPOSE_{'_'.join(map(str, item['loc'])).upper()}: {item['msg']}" for item in error.errors()
        )
        raise RigError(ErrorCode.CONFIG_INVALID, fields) from error


def refuse_open_bind(host: str, keys: bool) -> None:
    """Raises RigError config.invalid when others than this machine could call and there are no `keys` to tell them."""
    if not keys and not is_loopback(host):
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"The service does not listen on {host!r} without keys: whoever reaches it moves the arm. Make one with "
            "`lightpose keys add NAME --role operator`, or listen on 127.0.0.1 and reach it from elsewhere by an SSH "
            "tunnel (ssh -L 8000:127.0.0.1:8000 …).",
            host=host,
        )


def is_loopback(host: str) -> bool:
    """Whether a host is `localhost` or a loopback address."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
