"""The paths that a command line names, to tell a file that its user can put right from a defect of the program."""

import os
from collections.abc import Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from typer.core import TyperGroup

from api.cli.summaries import Summaries

_named: ContextVar[tuple[Path, ...]] = ContextVar("named", default=())


class Commands(Summaries):
    """The outermost group of commands, which keeps the paths that the arguments name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parses the arguments as any group does; `ctx.obj` keeps them as given."""
        ctx.obj = args[:]
        given = [arg.partition("=")[2] if arg.startswith("--") else arg for arg in args]
        environment = [value for name, value in os.environ.items() if name.startswith("LIGHTPOSE_") or name == "TMPDIR"]
        texts = [*given, *_defaults(self, args), *environment]
        _named.set(tuple(_real(text.removeprefix("file://")) for text in texts if text))
        return super().parse_args(ctx, args)


def is_named(path: str | Path) -> bool:
    """Whether the present command line, its defaults or the environment name a path.

    So they do if it lies below one that they name or above it, and if it is written beside it and named after it, as
    `board.json` beside `board.pdf`.
    """
    place = _real(path)
    return any(
        place.is_relative_to(one)
        or one.is_relative_to(place)
        or (place.parent == one.parent and one.stem in place.name)
        for one in _named.get()
    )


def _defaults(group: TyperGroup, args: Sequence[str]) -> list[str]:
    """Returns the paths that are defaults of the options of the command that `args` name."""
    command: Any = group
    for arg in args:
        command = getattr(command, "commands", {}).get(arg, command)
    return [str(option.default) for option in command.params if isinstance(option.default, Path)]


def _real(path: str | Path) -> Path:
    return Path(os.path.realpath(path))
