"""Groups of commands whose help has each command's summary in full."""

import inspect
from typing import Any

from typer.core import TyperGroup


class Summaries(TyperGroup):
    """A group of commands that does not cut the summaries in its help at half a sentence."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Returns a command, whose summary is the first paragraph of its help."""
        command = super().get_command(ctx, cmd_name)
        if command is not None and command.help and not command.short_help:
            command.short_help = " ".join(inspect.cleandoc(command.help).split("\n\n")[0].split())
        return command
