"""Options of `lightpose demo` and `lightpose sim` that choose the object in the simulated cell.

`hardware_sim.object_spec.choose` checks their combination; a command imports it when it runs.
"""

from pathlib import Path
from typing import Annotated

import typer

ObjectName = Annotated[
    str | None,
    typer.Option(
        "--object",
        help="sphere, vase, relief, part, bumps or figure; -textured, -glossy or -contrast after it for its versions; "
        "or a calibration target, as for lightpose place; default: vase",
    ),
]
MeshFile = Annotated[
    Path | None,
    typer.Option("--mesh", help="Your own object: a closed mesh, .stl, .ply or .obj, z up; instead of --object"),
]
SizeMm = Annotated[
    float | None,
    typer.Option(
        help="Largest extent of the --mesh, mm; default: the file's own, read as mm if it is more than 1, else as m"
    ),
]
Family = Annotated[
    str | None,
    typer.Option(
        help="A random object by --seed instead of --object: turned, relief, machined, vessel, cluster, blob, knot or "
        "sheet"
    ),
]
Reflects = Annotated[
    str | None,
    typer.Option(
        "--reflectance", help="lambert, oren-nayar:SIGMA (rad), ggx:ALPHA or metal:ALPHA; default: the object's own"
    ),
]
