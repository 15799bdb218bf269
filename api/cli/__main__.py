"""Runs the command line as `python -m api.cli`."""

from api.cli.commands import main

main()
