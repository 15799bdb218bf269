"""`lightpose solve | plan | replay`: options of the commands on folders of images, without a cell or a service."""

import json
from pathlib import Path
from typing import Annotated

import typer

from api.cli.error_exit import explain_errors
from api.cli.termination import cleaned_up_at_sigterm

app = typer.Typer()

FULL_SCALE = typer.Option(
    help="Stored value at which pixels clip, such as 4095 for 12 bits in 16-bit files; lights.json states its own"
)


@app.command("solve")
def solve_folder(
    folder: Annotated[
        Path, typer.Argument(help="DiLiGenT-style, .lp with images, near light (lights.json), or a session's folder")
    ],
    solver: Annotated[str, typer.Option(help="auto, or for comparison ls: plain least squares of directions")] = "auto",
    near: Annotated[bool, typer.Option("--near", help="Require the near-light model")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for maps and report; default: nothing is written")] = None,
    exports: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            help="With --out, also: normals_directx.png, maps.exr, albedo.exr, albedo.png, mesh.ply, lights.lp and "
            "lights.dome (lights without their images), diligent (with them), integration, or all; may be repeated",
        ),
    ] = None,
    sphere: Annotated[
        str | None, typer.Option(help="cx,cy,r: a sphere in the image, px, as the truth for the errors")
    ] = None,
    keep_steps: Annotated[
        bool, typer.Option("--keep-steps", help="Allow depth discontinuities where neighbouring normals disagree")
    ] = False,
    full_scale: Annotated[float | None, FULL_SCALE] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object as the last line")] = False,
) -> None:
    """Solves a folder of images to normals with an uncertainty for each pixel; grades them if the truth is known."""
    from api.cli import solving

    with cleaned_up_at_sigterm():
        outcome = explain_errors(
            lambda: solving.run(
                solving.solve_request(folder, solver, near, out, sphere, exports or [], keep_steps, full_scale)
            )
        )
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command("plan")
def plan_folder(
    folder: Annotated[Path, typer.Argument(help="Any folder that `solve` reads; its images are the pilot's")],
    count: Annotated[int, typer.Option(help="Number of further lights, 1 to 300")],
    candidates: Annotated[
        Path | None,
        typer.Option(help="Where lights can be: three numbers on each line, in the folder's own frame and unit"),
    ] = None,
    radius_mm: Annotated[
        float | None, typer.Option(help="Radius of a free dome; default: the pilot's mean distance from the object")
    ] = None,
    max_slant_deg: Annotated[
        float | None,
        typer.Option(help="Greatest slant from the view axis; default: 75 on a free dome, none for given candidates"),
    ] = None,
    pilot: Annotated[
        str | None,
        typer.Option(help="Use only these images, such as 0,7,31,90, counted from 0; the others are the candidates"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File for the JSON object; default: nothing is written")] = None,
    full_scale: Annotated[float | None, FULL_SCALE] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object as the last line")] = False,
) -> None:
    """Plans further lights for a folder of images, for any dome, ring or robot; moves nothing."""
    from api.cli import planning

    with cleaned_up_at_sigterm():
        outcome = explain_errors(
            lambda: planning.run(
                planning.plan_request(folder, count, candidates, radius_mm, max_slant_deg, pilot, out, full_scale)
            )
        )
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def replay(
    folder: Annotated[Path, typer.Argument(help="A session's folder")],
    result: Annotated[int | None, typer.Option(min=0, help="Which result to compare with; default: the last")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object as the last line")] = False,
) -> None:
    """Solves a session's images again and compares the normals with its stored result; writes nothing."""
    from api.cli import replaying

    outcome = explain_errors(lambda: replaying.replay(folder, result))
    if as_json:
        print(json.dumps(outcome), flush=True)
