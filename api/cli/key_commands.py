"""`lightpose keys …`: who may call the service."""

import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from api.cli.error_exit import explain_errors
from api.cli.summaries import Summaries

DataFolder = Annotated[Path, typer.Option(envvar="LIGHTPOSE_DATA", help="The service's data folder")]

app = typer.Typer(cls=Summaries, no_args_is_help=True, help="API keys: who may call the service, and what they may do.")


@app.command("add")
def add_key(
    name: Annotated[str, typer.Argument(help="A new name for its holder, a person or a machine")],
    role: Annotated[
        str, typer.Option(help="viewer reads, operator moves the arm, admin deletes sessions too")
    ] = "operator",
    data: DataFolder = Path("data"),
) -> None:
    """Creates a key and prints its secret, which is not stored."""
    from api.rest import keys

    roles = [str(item) for item in keys.Role]
    if role not in roles:
        raise typer.BadParameter(f"choose one of {', '.join(roles)}", param_hint="--role")
    print(explain_errors(lambda: keys.add(keys.path_in(data), name, keys.Role(role))))


@app.command("revoke")
def revoke_key(
    name: Annotated[str, typer.Argument(help="The key's name, as `keys list` prints it")],
    data: DataFolder = Path("data"),
) -> None:
    """Revokes a key; a running service refuses it within a second."""
    from api.rest import keys

    explain_errors(lambda: keys.revoke(keys.path_in(data), name))


@app.command("list")
def list_keys(data: DataFolder = Path("data")) -> None:
    """Lists names and roles of the keys; secrets are not stored."""
    from api.rest import keys

    content = explain_errors(lambda: keys.read(keys.path_in(data)))
    if content is None:
        print(f"no keys in {data}: only this machine can connect, and everybody on it is an operator", file=sys.stderr)
    elif not content.keys:
        print(f"no keys in {data}: all were revoked, and the service refuses everybody", file=sys.stderr)
    for key in content.keys if content is not None else ():
        print(f"{key.name}\t{key.role}\tmade {datetime.fromtimestamp(key.created_at, UTC):%Y-%m-%d}")
