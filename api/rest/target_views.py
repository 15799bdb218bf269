"""Routes that help a person who calibrates: the target in the live image, and the planned views, in pixels.

Both are coordinates, not drawings: a page lays them over the picture in its own style, and a script compares them.
"""

from fastapi import APIRouter, Request, Response
from pydantic import Field

from acquisition.calibrate import board_view
from acquisition.calibrate.board_view import ExpectedView, Pixel
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.store.folder import read_value
from acquisition.waypoints import mounted_tool
from api.rest import camera_preview, problems, stored_files
from api.rest.camera_preview import CameraPreview
from api.rest.dependencies import Number, ServiceOf, SessionId
from api.rest.schemas import Links, Resource
from api.rest.turns import in_turn
from api.rest.wiring import Service

router = APIRouter()


class TargetView(Resource):
    """The calibration board in the present preview image."""

    frame: int = Field(description="Number in the header `X-Frame-Number` of the picture of the same frame")
    width_px: int = Field(description="Width of the frame, px")
    height_px: int = Field(description="Height of the frame, px")
    seen: bool = Field(description="Whether enough of the board is seen for a view of a calibration")
    why_not: str = Field(description="Why it is not, for people; empty: it is")
    corners_px: list[Pixel] = Field(description="The corners found: column and row, pixels of the frame")
    corners: int = Field(ge=0, description="All corners of the board")


class PlannedView(Resource):
    """One planned view of a pass."""

    number: int = Field(ge=0, description="Number within the pass, from 0: `light_number` of its image")
    reason: str = Field(description="Why it was chosen")
    taken: bool = Field(description="Whether its image has been taken")
    view: ExpectedView | None = Field(description="Where the board will be; null: not in front of the camera")


class PlannedViews(Resource):
    """Planned views of a pass of a calibration session with the board, as predicted by the best estimate before it."""

    width_px: int = Field(description="Width of the camera's image, px")
    height_px: int = Field(description="Height of the camera's image, px")
    estimate: int | None = Field(
        description="Number of the estimate that predicts them; null: the session's calibration"
    )
    next: int | None = Field(description="Number of the view that is taken next; null: not known yet, or all are taken")
    views: list[PlannedView] = Field(description="The pass's views")
    links: Links


@router.get(
    "/v1/rig/preview/target",
    tags=["rig"],
    responses={
        **camera_preview.PROBLEMS,
        **problems.responses_of(ErrorCode.CONFIG_INVALID),
    },
)
async def preview_target(request: Request, service: ServiceOf, response: Response) -> TargetView:
    """Detects the calibration board of the cell file in the present image, as in a session's images.

    While a session holds the rig, the present image is the last frame that the session captured.
    """
    preview: CameraPreview = request.app.state.camera_preview
    response.headers["Cache-Control"] = "no-store"
    board = mounted_tool.require_board(service.cell)
    image, view, why_not = await preview.board(board)
    height, width = image.pixels.shape
    return TargetView(
        frame=image.number,
        width_px=width,
        height_px=height,
        seen=view is not None,
        why_not=why_not,
        corners_px=[] if view is None else [(round(x, 2), round(y, 2)) for x, y in view.pixels.tolist()],
        corners=(board.columns - 1) * (board.rows - 1),
    )


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/views",
    tags=["sessions"],
    responses={**problems.NOT_FOUND, **problems.responses_of(ErrorCode.STORE_CORRUPT)},
)
def planned_views(service: ServiceOf, session_id: SessionId, number: Number) -> PlannedViews:
    """Predicts where the board will be in the images of a pass: outline and corners of each planned view.

    The prediction uses the newest estimate before the pass, else the calibration that the session began with.
    """
    service.store.journal.session(session_id)
    entry = stored_files.newest(service, session_id, "plan", number)
    folder = service.store.folder(session_id)
    plan = None if entry is None else read_value(LightPlan, folder, entry.path)
    if plan is None or (plan.joints is None and plan.method != "views"):
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Pass {number} of session {session_id} has no views of a board")
    estimate = next((one for one in range(number - 1, -1, -1) if _calibrates(service, session_id, one)), None)
    known = folder if estimate is None else folder / f"estimates/{estimate}"
    calibration = cell_config.load_calibration(known / "calibration.json")
    cell = read_value(CellConfig, folder, "cell.json")
    shots = [shot for shot in service.store.journal.shots(session_id) if shot.key.pass_number == number]
    taken = {shot.light_number for shot in shots if shot.kind == "light"}
    route = stored_files.newest(service, session_id, "route", number)
    order: list[int] = [] if route is None else route.body["order"]
    return PlannedViews(
        width_px=calibration.width,
        height_px=calibration.height,
        estimate=estimate,
        next=next((view for view in order if view not in taken), None),
        views=_views(plan, cell, calibration, taken),
        links={
            "pass": f"/v1/sessions/{session_id}/passes/{number}",
            "session": f"/v1/sessions/{session_id}",
        },
    )


@router.post(
    "/v1/dry-runs/views",
    tags=["sessions"],
    responses=problems.responses_of(
        *problems.BODY_CODES,
        ErrorCode.RIG_BUSY,
        ErrorCode.CONFIG_INVALID,
        ErrorCode.WAYPOINTS_UNREACHABLE,
        ErrorCode.CALIBRATION_INFEASIBLE,
        ErrorCode.SESSION_STEP_FAILED,
        ErrorCode.COMPUTE_LOST,
        ErrorCode.SERVICE_OVERLOADED,
    ),
)
async def foreseen_views(service: ServiceOf, recipe: BoardRecipe) -> PlannedViews:
    """Predicts where the board will be in the first images of a calibration session before it exists. Nothing moves.

    The prediction uses the calibration in use; the board need not be on the flange yet. A session of the same recipe
    plans the same views while that calibration is in use, in an order that depends on where the arm stands.
    """
    plan, calibration = await in_turn(service.limits.reach, service.runner.planning.first_views, recipe)
    return PlannedViews(
        width_px=calibration.width,
        height_px=calibration.height,
        estimate=None,
        next=None,
        views=_views(plan, service.cell, calibration, taken=set()),
        links={"calibration": "/v1/rig/calibration"},
    )


def _views(plan: LightPlan, cell: CellConfig, calibration: Calibration, taken: set[int | None]) -> list[PlannedView]:
    return [
        PlannedView(
            number=view,
            reason=reason,
            taken=view in taken,
            view=board_view.expected(joints, cell, calibration),
        )
        for view, (joints, reason) in enumerate(zip(plan.joints or [], plan.reasons, strict=False))
    ]


def _calibrates(service: Service, session_id: str, number: int) -> bool:
    """Returns whether a session has an estimate of this number with values."""
    entry = stored_files.newest(service, session_id, "estimate", number)
    return entry is not None and bool(entry.body["estimated"])
