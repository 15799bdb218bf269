"""`lightpose camera`: options of the command, whose work is in `camera_trial`."""

import json
from pathlib import Path
from typing import Annotated

import typer

from api.cli.error_exit import explain_errors


def camera(
    cell: Annotated[Path, typer.Option(envvar="LIGHTPOSE_CELL", help="The cell file; only its camera is connected")],
    count: Annotated[int, typer.Option(min=1, max=100_000, help="Number of frames")] = 100,
    exposure_s: Annotated[float | None, typer.Option(help="Exposure time, s; default: 0.01, within the limits")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object as the last line")] = False,
) -> None:
    """Takes frames without the arm; reports lost, late, doubled and damaged ones, the intervals and the noise."""
    from api.cli import camera_trial

    trial = explain_errors(lambda: camera_trial.run(cell, count, exposure_s))
    if as_json:
        print(json.dumps(camera_trial.as_dictionary(trial)))
    else:
        camera_trial.print_trial(trial)
