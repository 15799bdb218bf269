"""Runs the command line as `python -m api.cli`. Guarded, because exporting processes import their parent's module."""

from api.cli.commands import main

if __name__ == "__main__":
    main()
