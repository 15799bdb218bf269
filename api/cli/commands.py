"""The command line: `lightpose demo | sim | serve | check | solve | plan | calibrate | …`.

Each command imports what it needs when it runs, so that `lightpose --help` answers at once and loads neither numerical
kernels nor an HTTP library.
"""

import json
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from api.cli import archive_commands, calibrate_commands, camera_command, folder_commands, kernel_cache, key_commands
from api.cli.error_exit import explain_errors
from api.cli.key_commands import DataFolder
from api.cli.named_paths import Commands
from api.cli.object_options import Family, MeshFile, ObjectName, Reflects, SizeMm

app = typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, rich_markup_mode=None)


class Profile(StrEnum):
    """Deviations of the simulated cell from its calibration."""

    IDEAL = "ideal"
    DIRECT = "direct"
    REALISTIC = "realistic"


class PolyScope(StrEnum):
    """Generations of the controller's software."""

    FIVE = "5"
    X = "x"


class LogFormat(StrEnum):
    """Format of log entries."""

    TEXT = "text"
    JSON = "json"


def _print_version(wanted: bool) -> None:
    """Prints the version, and ends."""
    if wanted:
        from importlib.metadata import version

        print(f"lightpose {version('lightpose')}")
        raise typer.Exit


@app.callback()
def lightpose(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version, and end")
    ] = False,
) -> None:
    """Photometric stereo with planned lights."""
    if context.invoked_subcommand in kernel_cache.COMMANDS and "--help" not in context.obj:
        explain_errors(kernel_cache.require_writable)


ChosenProfile = Annotated[
    Profile,
    typer.Option(
        help="How the cell differs from its calibration: ideal, not at all and without noise; direct, in the lamp's "
        "place and intensity; realistic, also in the camera's pose, with room light and light between surfaces"
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of object, errors and noise")]
Speed = Annotated[float, typer.Option(min=0.1, max=100, help="Speed of the simulated arm as a multiple of real time")]
Pixels = Annotated[int, typer.Option(min=32, max=4096, help="Width and height of the simulated image")]


@app.command()
def demo(
    object_name: ObjectName = None,
    mesh: MeshFile = None,
    size_mm: SizeMm = None,
    family: Family = None,
    reflectance: Reflects = None,
    seed: Seed = 1,
    pilot: Annotated[int, typer.Option(help="Number of pilot lights, 3 to 16")] = 4,
    planned: Annotated[int, typer.Option(help="Number of planned lights, 0 to 64")] = 4,
    method: Annotated[
        str,
        typer.Option(
            help="How lights are chosen: optimal, two-rings, ring, drbohlav, max-distance, paper, random or user"
        ),
    ] = "optimal",
    lights: Annotated[
        Path | None,
        typer.Option(help="Positions for method `user`: x y z on each line, m, view frame; JSON; a session's folder"),
    ] = None,
    profile: ChosenProfile = Profile.REALISTIC,
    random: Annotated[bool, typer.Option(help="Compare with the same number of random lights")] = True,
    speed: Speed = 8.0,
    pixels: Pixels = 1024,
    data: Annotated[Path, typer.Option(help="Folder for the cell and the results")] = Path("demo"),
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="First calibrate the cell in calibration sessions, and grade that too")
    ] = False,
    perturb: Annotated[
        bool, typer.Option("--perturb", help="With --calibrate: a cell that was never calibrated")
    ] = False,
    page: Annotated[
        bool, typer.Option("--page", help="Run no session: serve the operator's page until Ctrl+C")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object as the last line")] = False,
) -> None:
    """Runs a full session in a simulated cell over HTTP, and grades its normals against the truth."""
    from api.cli import demo as demonstration
    from hardware_sim import object_spec

    options = demonstration.DemoOptions(
        spec=explain_errors(lambda: object_spec.choose(object_name, mesh, size_mm, family, reflectance)),
        seed=seed,
        pilot_lights=pilot,
        planned_lights=planned,
        method=method,
        profile=profile.value,
        compare_random=random,
        speed=speed,
        pixels=pixels,
        data=data,
        lights=lights,
        perturbed=perturb,
    )
    if perturb and not calibrate:
        raise typer.BadParameter(
            "needs --calibrate: without it, images are graded by the cell's nominal values", param_hint="--perturb"
        )
    if calibrate:
        from api.cli import calibration_demo

        found = explain_errors(lambda: calibration_demo.run(options, quiet=as_json))
        if as_json:
            print(json.dumps(found), flush=True)
        return
    if page:
        explain_errors(lambda: demonstration.serve_page(options))
        return
    outcome = explain_errors(lambda: demonstration.run(options))
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def sim(
    address: Annotated[str, typer.Option(help="A loopback address, a different one for each cell")] = "127.0.0.1",
    object_name: ObjectName = None,
    mesh: MeshFile = None,
    size_mm: SizeMm = None,
    family: Family = None,
    reflectance: Reflects = None,
    seed: Seed = 1,
    profile: ChosenProfile = Profile.REALISTIC,
    speed: Speed = 1.0,
    pixels: Pixels = 1024,
    folder: Annotated[
        Path | None, typer.Option(help="Folder for cell file, calibration and truth; default: a temporary one")
    ] = None,
    cell: Annotated[
        Path | None, typer.Option(help="The cell file to simulate; default: lightpose's own simulated cell")
    ] = None,
    calibration_seed: Annotated[
        int | None,
        typer.Option(help="Seed of kinematic deviations of millimetres, as real arms have them; default: none"),
    ] = None,
    record: Annotated[Path | None, typer.Option(help="Record every tick of the controller to this file")] = None,
    programs: Annotated[
        Path | None, typer.Option(help="Folder of programs (NAME.urp) that the dashboard loads")
    ] = None,
    perturbed: Annotated[
        bool, typer.Option("--perturb", help="A cell that was never calibrated: its calibration.json is wrong")
    ] = False,
    polyscope: Annotated[
        PolyScope | None, typer.Option(help="Software of the simulated controller; default: the cell file's")
    ] = None,
    json_status: Annotated[bool, typer.Option("--json-status", help="A JSON line at each change of the arm")] = False,
) -> None:
    """Runs a simulated cell until interrupted; prints a line `ready …` when it accepts connections."""
    from acquisition.formats.session_files import refuse_in_session
    from hardware_sim import cell as simulation
    from hardware_sim import object_spec

    for option, path in (("--folder", folder), ("--record", record)):
        if path is not None:
            explain_errors(partial(refuse_in_session, path, option))
    explain_errors(
        lambda: simulation.run(
            simulation.CellOptions(
                address,
                object_spec.choose(object_name, mesh, size_mm, family, reflectance),
                seed,
                profile.value,
                speed,
                pixels=pixels,
                cell_file=cell,
                calibration_seed=calibration_seed,
                record=record,
                programs=programs,
                perturbed=perturbed,
                polyscope=None if polyscope is None else "x" if polyscope is PolyScope.X else "5",
            ),
            folder=folder,
            json_status=json_status,
            say=typer.echo,  # in one write, also without a buffer
        )
    )


@app.command()
def place(
    name: Annotated[
        str,
        typer.Argument(
            help="charuco, mirror-sphere, matt-plane or grey-tile (@flange: on the flange; #N: laid down another way), "
            "empty, or a built-in object"
        ),
    ],
    address: Annotated[str, typer.Option(help="The simulated cell's address")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="The port of its camera")] = 30100,
) -> None:
    """Puts another object or calibration target into a running simulated cell, as an operator does between sessions."""
    from hardware_sim import placing

    print(f"placed {explain_errors(lambda: placing.place(address, port, name))}", flush=True)


@app.command()
def serve(
    cell: Annotated[Path | None, typer.Option(help="The cell file; default: LIGHTPOSE_CELL")] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder of journal and sessions; default: LIGHTPOSE_DATA, else data")
    ] = None,
    host: Annotated[
        str | None, typer.Option(help="Address to listen at; default: LIGHTPOSE_HOST, else 127.0.0.1")
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="Port to listen at, 0: any free one; default: LIGHTPOSE_PORT, else 8000"),
    ] = None,
    log: Annotated[
        LogFormat | None,
        typer.Option(help="Log as lines for people or as JSON objects; default: LIGHTPOSE_LOG, else text"),
    ] = None,
    tls_cert: Annotated[Path | None, typer.Option(help="Certificate (PEM); default: LIGHTPOSE_TLS_CERT")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="Its private key (PEM); default: LIGHTPOSE_TLS_KEY")] = None,
    trusted_proxy: Annotated[
        list[str] | None,
        typer.Option(
            help="Proxy whose X-Forwarded-For and -Proto are trusted; may be repeated; default: "
            "LIGHTPOSE_TRUSTED_PROXIES"
        ),
    ] = None,
) -> None:
    """Runs the service for one cell."""
    from api.rest import server, settings

    given = {"cell": cell, "data": data, "host": host, "port": port, "log": None if log is None else log.value}
    more = {"tls_cert": tls_cert, "tls_key": tls_key, "trusted_proxies": tuple(trusted_proxy or ()) or None}
    wanted: dict[str, object] = {name: value for name, value in {**given, **more}.items() if value is not None}
    explain_errors(lambda: server.serve(settings.read(**wanted)))


@app.command()
def check(
    cell: Annotated[
        Path | None, typer.Option(envvar="LIGHTPOSE_CELL", help="The cell file; default: the simulated cell's")
    ] = None,
    offline: Annotated[bool, typer.Option("--offline", help="Do not connect to arm and camera")] = False,
    data: Annotated[
        Path | None,
        typer.Option(envvar="LIGHTPOSE_DATA", help="The service's data folder, to check its keys and free space too"),
    ] = None,
) -> None:
    """Checks cell file, calibration, reach, pilot, route and devices, and names each problem; moves nothing."""
    from api.cli import checking
    from hardware_sim import nominal

    cell_file = cell or nominal.default_cell_file()
    if not explain_errors(lambda: checking.check(cell_file, offline=offline, data=data)):
        raise typer.Exit(1)


app.command()(camera_command.camera)
app.add_typer(calibrate_commands.app, name="calibrate")
app.add_typer(archive_commands.app, name="archive")

app.add_typer(key_commands.app, name="keys")


@app.command()
def prune(
    older_than: Annotated[
        float,
        typer.Option(
            "--older-than-days",
            "--older-than",
            min=0,
            help="Days since a session ended or, if never started, was created",
        ),
    ] = 30,
    keep: Annotated[int, typer.Option(min=0, help="Number of newest ended sessions that are always kept")] = 10,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only list what would be removed")] = False,
    data: DataFolder = Path("data"),
) -> None:
    """Removes old sessions with their files: ended ones and those that were never started; queued ones stay."""
    from api.cli import pruning

    if not explain_errors(lambda: pruning.prune(data, older_than, keep, dry_run=dry_run)):
        raise typer.Exit(1)


app.add_typer(folder_commands.app)


@app.command()
def study(
    quick: Annotated[bool, typer.Option("--quick", help="Few draws; takes less than a minute")] = False,
    seed: Seed = 1,
    out: Annotated[Path, typer.Option(help="Folder for study.html and study.json")] = Path("study"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object as the last line")] = False,
) -> None:
    """Compares methods of placing lights and checks the paper's figures, as a page and JSON; moves nothing."""
    from api.cli.study import run

    figures = explain_errors(lambda: run.run(seed, out, quick=quick))
    print(out / "study.html")
    if as_json:
        print(json.dumps(figures), flush=True)


@app.command()
def warm() -> None:
    """Compiles the numerical kernels into their cache, so that no session waits for that."""
    import importlib

    for module in (
        "acquisition.runner.jobs",
        "acquisition.normals.distant",
        "acquisition.normals.near_light",
        "hardware_sim.world",
    ):
        importlib.import_module(module)
    print("kernels are compiled")


def main() -> None:
    """Entry point of the `lightpose` command."""
    app()
