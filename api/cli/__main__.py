"""Runs the command line as `python -m api.cli`; guarded, because a process that exports imports its parent's module."""

from api.cli.commands import main

if __name__ == "__main__":
    main()
