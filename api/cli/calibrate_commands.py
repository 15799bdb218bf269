"""`lightpose calibrate …`: options of the commands, whose work is in `calibrating` and `session_calibrating`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from api.cli.error_exit import explain_errors
from api.cli.summaries import Summaries

if TYPE_CHECKING:
    from acquisition.models.calibration_recipe import AnyRecipe

app = typer.Typer(
    cls=Summaries,
    no_args_is_help=True,
    help="Calibrates the cell from images of a board, a mirror sphere and a matt plane; with --address the arm moves.",
)

Images = Annotated[Path, typer.Argument(help="Folder of images, PNG or TIFF, all of one size")]
ImagesOrService = Annotated[
    Path | None, typer.Argument(help="Folder of images, PNG or TIFF, all of one size; or none, with --address")
]
Address = Annotated[
    str | None, typer.Option(help="A running service that takes the images, such as http://127.0.0.1:8000")
]
Mounted = Annotated[
    bool, typer.Option("--mounted", help="With --address: states that the board is on the arm's flange")
]
SessionImages = Annotated[int, typer.Option("--images", help="With --address: maximum number of images")]
Activate = Annotated[bool, typer.Option("--activate", help="With --address: put the result into use")]
LampImages = Annotated[
    int, typer.Option("--images", help="With --address: number of images, sphere and plane together")
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask: each target is put into place when the output says so")]
Simulated = Annotated[
    str | None, typer.Option(help="A simulated cell's address: its stage puts the targets into place, nobody is asked")
]
BoardFile = Annotated[Path, typer.Option("--board", help="Description of the board, as `calibrate board` writes it")]
Out = Annotated[Path, typer.Option(help="Folder for the results; nothing in it is overwritten")]
Base = Annotated[Path | None, typer.Option(help="A calibration.json: also write a copy of it with the new values")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object as the last line")]


@app.command()
def board(
    out: Annotated[Path, typer.Option(help="PDF or SVG; its description goes beside it as .json")] = Path("board.pdf"),
    columns: Annotated[int, typer.Option(help="Squares along x")] = 9,
    rows: Annotated[int, typer.Option(help="Squares along y")] = 7,
    square_mm: Annotated[float, typer.Option(help="Side of a square, mm")] = 12.0,
    border: Annotated[
        int, typer.Option(help="0: squares all over; n: a frame of n squares round a blank middle, for the lamp's lobe")
    ] = 0,
    legacy_pattern: Annotated[
        bool, typer.Option("--legacy-pattern", help="Pattern of OpenCV before 4.6 and of calib.io, for even rows")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Draws a ChArUco board to print, to scale."""
    from api.cli import calibrating

    outcome = explain_errors(
        lambda: calibrating.draw_board(columns, rows, square_mm, out, border=border, legacy=legacy_pattern)
    )
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def camera(
    folder: ImagesOrService = None, board_file: BoardFile = Path("board.json"), out: Out = Path("calibration"),
    base: Base = None, address: Address = None, mounted: Mounted = False, images: SessionImages = 20,
    target_px: Annotated[
        float | None, typer.Option(help="With --address: stop when the projection uncertainty (1 σ) reaches this, px")
    ] = None,
    activate: Activate = False, as_json: AsJson = False,
) -> None:  # fmt: skip
    """Calibrates camera matrix and distortion from images of the board, held or laid anywhere.

    With --address the service takes them itself, with the board on the arm's flange.
    """
    _refuse_both(folder, address)
    if address is None:
        from api.cli import calibrating

        images_in = _folder(folder)
        outcome = explain_errors(lambda: calibrating.calibrate_camera(images_in, board_file, out, base))
    else:
        wanted = {"kind": "camera", "max_images": images, "target_px": target_px}
        outcome = _session(address, wanted, mounted=mounted, activate=activate)
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command("hand-eye")
def hand_eye(
    folder: ImagesOrService = None,
    cell: Annotated[
        Path | None, typer.Option(help="With FOLDER: the cell file, for the arm's model or factory kinematics")
    ] = None,
    board_file: BoardFile = Path("board.json"),
    out: Out = Path("calibration"),
    base: Base = None,
    candidates: Annotated[
        Path | None, typer.Option(help="Joints of possible further views, like joints.csv; the best next one is named")
    ] = None,
    address: Address = None,
    mounted: Mounted = False,
    images: SessionImages = 20,
    target_mm: Annotated[
        float | None, typer.Option(help="With --address: stop when the camera's position (1 σ) is known to this, mm")
    ] = None,
    activate: Activate = False,
    as_json: AsJson = False,
) -> None:
    """Calibrates the camera's pose in the arm's base frame, from images of the board on the flange.

    The folder holds joints.csv: for each image a line with its name and the six joints in rad. With --address the
    service takes the images itself.
    """
    _refuse_both(folder, address)
    if address is None:
        from api.cli import calibrating

        images_in = _folder(folder)
        if cell is None:
            raise typer.BadParameter("is needed for a folder of images", param_hint="--cell")
        outcome = explain_errors(
            lambda: calibrating.calibrate_hand_eye(images_in, board_file, cell, out, base, candidates)
        )
    else:
        wanted = {"kind": "hand-eye", "max_images": images, "target_mm": target_mm}
        outcome = _session(address, wanted, mounted=mounted, activate=activate)
    if as_json:
        print(json.dumps(outcome), flush=True)


def _refuse_both(folder: Path | None, address: str | None) -> None:
    if folder is not None and address is not None:
        raise typer.BadParameter("give a folder of images or the service's --address, not both", param_hint="FOLDER")


def _folder(folder: Path | None) -> Path:
    if folder is None:
        raise typer.BadParameter("give a folder of images, or the service's --address", param_hint="FOLDER")
    return folder


def _session(address: str, wanted: dict[str, Any], *, mounted: bool, activate: bool) -> dict[str, Any]:
    """Runs a session at the service with the recipe that the options describe."""
    from api.cli import session_calibrating

    return explain_errors(
        lambda: session_calibrating.calibrate(address, _recipe(wanted), mounted=mounted, activate=activate)
    )


def _recipe(wanted: dict[str, Any]) -> "AnyRecipe":
    """Returns the recipe that the options describe."""
    from pydantic import ValidationError

    from acquisition.models import calibration_recipe
    from acquisition.models.errors import in_words

    try:
        return calibration_recipe.read(json.dumps(wanted))
    except ValidationError as error:
        wrong = error.errors()[0]
        names = [str(part) for part in wrong["loc"] if part not in calibration_recipe.TAGS] or ["options"]
        name = names[0].replace("max_images", "images").replace("_", "-")
        raise typer.BadParameter(in_words(wrong), param_hint=f"--{name}") from error


@app.command()
def response(
    folder: ImagesOrService = None,
    base: Annotated[
        Path | None, typer.Option(help="With FOLDER: the calibration.json whose sensor is replaced")
    ] = None,
    out: Out = Path("calibration"),
    address: Address = None,
    images: Annotated[
        int, typer.Option("--images", help="With --address: number of images, four for each exposure time")
    ] = 49,
    activate: Activate = False,
    as_json: AsJson = False,
) -> None:
    """Calibrates the camera's response: black level, gain, read noise, full well, linearity, defective pixels.

    The folder holds response.csv: image, lamp (on or off), exposure time in s, and optionally the time taken, in s. It
    needs two images with the lamp and two without at each of at least five exposure times, of one scene that does not
    move. With --address the service takes them, at one light with the arm at rest.
    """
    _refuse_both(folder, address)
    if address is None:
        from api.cli import response_calibrating

        images_in = _folder(folder)
        if base is None:
            raise typer.BadParameter("is needed for a folder of images", param_hint="--base")
        outcome = explain_errors(lambda: response_calibrating.calibrate_response(images_in, base, out))
    else:
        outcome = _session(address, {"kind": "response", "max_images": images}, mounted=False, activate=activate)
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def lamp(
    folder: ImagesOrService = None,
    cell: Annotated[
        Path | None, typer.Option(help="With FOLDER: the cell file, for the arm and where the object stands")
    ] = None,
    base: Annotated[
        Path | None, typer.Option(help="With FOLDER: a calibration.json with the calibrated camera and its pose")
    ] = None,
    hand_eye_file: Annotated[
        Path | None, typer.Option("--hand-eye", help="With FOLDER: hand_eye.json, with the uncertainty of that pose")
    ] = None,
    radius_mm: Annotated[float | None, typer.Option(help="With FOLDER: radius of the mirror sphere, mm")] = None,
    out: Out = Path("calibration"),
    address: Address = None,
    images: LampImages = 72,
    yes: Yes = False,
    simulated: Simulated = None,
    activate: Activate = False,
    as_json: AsJson = False,
) -> None:  # fmt: skip
    """Calibrates the lamp's position in the tool's frame, from its highlights on a mirror sphere in the object's place.

    The folder holds joints.csv, as for hand-eye. Tilt the lamp to different sides, up to 45° away from the sphere. With
    --address the service takes the images itself, of the sphere and then of a matt plane, for intensity and lobe too.
    """
    _refuse_both(folder, address)
    if address is not None:
        recipe = _recipe({"kind": "lamp", "max_images": images})
        outcome = _in_turn(address, [recipe], yes=yes, simulated=simulated, activate=activate)
    else:
        from api.cli import lamp_calibrating

        images_in = _folder(folder)
        if cell is None or base is None or hand_eye_file is None or radius_mm is None:
            raise typer.BadParameter(
                "a folder of images needs --cell, --base, --hand-eye and --radius-mm", param_hint="FOLDER"
            )
        outcome = explain_errors(
            lambda: lamp_calibrating.calibrate_lamp(images_in, cell, base, hand_eye_file, radius_mm, out)
        )
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def check(
    address: Annotated[str, typer.Option(help="The running service, such as http://127.0.0.1:8000")],
    target: Annotated[
        str | None,
        typer.Option(help="board (on the flange) or plane (in the object's place); default: by the tool on the flange"),
    ] = None,
    mounted: Annotated[bool, typer.Option("--mounted", help="States that the board is on the arm's flange")] = False,
    images: Annotated[int, typer.Option("--images", help="Number of images, at least 6")] = 8,
    as_json: AsJson = False,
) -> None:
    """Checks with few images whether the calibration in use is still valid; suggested daily. Changes nothing.

    The board on the flange checks camera, arm and lens. The matt plane in the object's place, with the lamp on the
    flange, checks the lamp. The exit code is 3 if something has changed, and the output names it.
    """
    from api.cli import session_calibrating

    def run() -> dict[str, Any]:
        looked_at = target or session_calibrating.target_at_hand(address)
        recipe = _recipe({"kind": "check", "target": looked_at, "max_images": images})
        return session_calibrating.calibrate(address, recipe, mounted=mounted, activate=False)

    outcome = explain_errors(run)
    if as_json:
        print(json.dumps(outcome), flush=True)
    if not outcome["passed"]:
        raise typer.Exit(3)


@app.command("all")
def everything(
    address: Annotated[str, typer.Option(help="The running service, such as http://127.0.0.1:8000")],
    hand_eye_images: Annotated[
        int, typer.Option(help="Images of the board for the camera and its pose, at least 8")
    ] = 36,
    lamp_images: Annotated[int, typer.Option(help="Images of sphere and plane, at least 36")] = 72,
    yes: Yes = False,
    simulated: Simulated = None,
    activate: Annotated[
        bool, typer.Option("--activate", help="Do not ask: put each result into use; needed with --yes or --simulated")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrates camera, its pose and the lamp in turn, and says what a person has to put into the cell in between.

    Camera, pose and the arm's joint offsets come from the same images of the board. After each result the command asks
    whether to use it from then on: the lamp's images need the first. `PUT /v1/rig/calibrations/active` goes back to an
    earlier one.
    """
    if (yes or simulated is not None) and not activate:
        raise typer.BadParameter(
            "is needed with --yes or --simulated, which ask nothing: the lamp's images are computed with the result "
            "before",
            param_hint="--activate",
        )
    wanted = (
        {"kind": "hand-eye", "max_images": hand_eye_images},
        {"kind": "lamp", "max_images": lamp_images},
    )
    recipes = [_recipe(one) for one in wanted]
    outcome = _in_turn(address, recipes, yes=yes, simulated=simulated, activate=activate)
    if as_json:
        print(json.dumps(outcome), flush=True)


def _in_turn(
    address: str, recipes: "list[AnyRecipe]", *, yes: bool, simulated: str | None, activate: bool
) -> dict[str, Any]:
    from api.cli import calibrating_in_turn

    return explain_errors(
        lambda: calibrating_in_turn.at_terminal(address, recipes, yes=yes, simulated=simulated, activate=activate)
    )


@app.command()
def lobe(
    folder: Images,
    cell: Annotated[Path, typer.Option(help="The cell file, for the arm")],
    base: Annotated[Path, typer.Option(help="A calibration.json with calibrated camera, its pose, lamp position")],
    hand_eye_file: Annotated[Path, typer.Option("--hand-eye", help="hand_eye.json, with the uncertainty of that pose")],
    lamp_file: Annotated[Path, typer.Option("--lamp", help="lamp.json, with the uncertainty of the lamp's position")],
    board_file: BoardFile = Path("board.json"),
    albedo: Annotated[float, typer.Option(help="Reflectance of the plane's blank middle, 0–1")] = 0.85,
    albedo_sigma: Annotated[float, typer.Option(help="1 σ of --albedo, as a fraction")] = 0.01,
    out: Out = Path("calibration"),
    as_json: AsJson = False,
) -> None:  # fmt: skip
    """Calibrates the lamp's intensity and lobe, from images of a matt plane in a ChArUco frame in the object's place.

    The folder holds plane.csv: image, lamp-off image, exposure time in s, placing (any name), the six joints in rad.
    """
    from api.cli import lobe_calibrating

    files = lobe_calibrating.LobeFiles(cell, base, hand_eye_file, lamp_file, board_file)
    outcome = explain_errors(lambda: lobe_calibrating.calibrate_lobe(folder, files, albedo, albedo_sigma, out))
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def colour(
    folder: Images,
    base: Annotated[
        Path, typer.Option(help="The calibration.json whose colour is replaced; its sensor states the mosaic")
    ],
    reference: Annotated[
        Path | None,
        typer.Option(help="24 lines name,L,a,b (CIELAB, D50), row by row; default: the usual chart's published values"),
    ] = None,
    corners: Annotated[
        str | None,
        typer.Option(
            help="Centres of the patches dark skin, bluish green, black, white, px: 'x,y x,y x,y x,y'; default: found "
            "by the frame's markers"
        ),
    ] = None,
    out: Out = Path("calibration"),
    as_json: AsJson = False,
) -> None:
    """Calibrates white balance and colour matrix, from linear images of a 24-patch chart under the lamp.

    The folder holds colour.csv with a line for each placing of the chart: image, lamp-off image of the same exposure
    time.
    """
    from api.cli import colour_calibrating

    outcome = explain_errors(lambda: colour_calibrating.calibrate_colour(folder, base, out, reference, corners))
    if as_json:
        print(json.dumps(outcome), flush=True)
