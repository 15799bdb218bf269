"""Examples of the bodies of calibration sessions for the OpenAPI description: a board, a planned view, an estimate."""

from datetime import UTC, datetime

from pydantic import BaseModel

from acquisition.calibrate.board_view import ExpectedView
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.calibration_result import CalibrationSummary
from api.rest.calibration_sessions import CalibrationKindResource, EstimateResource
from api.rest.schemas import ArtefactResource, Page
from api.rest.target_views import PlannedView, PlannedViews, TargetView

_ID = "20261123-140000-3f9c2a"
_SESSION_PATH = f"/v1/sessions/{_ID}"
_SHA256 = "3f1d9a" + 58 * "0"

_KIND = CalibrationKindResource(
    kind="hand-eye",
    recipe="BoardRecipe",
    explanation="`camera`: matrix and distortion; `hand-eye`: these and `base_from_camera`",
    tool="board",
    made_at="2026-11-23T14:00:00Z",
    age_days=0.3,
    calibration=_ID,
    links={"sessions": "/v1/sessions", "tool": "/v1/rig/tool", "calibrations": "/v1/rig/calibrations"},
)
_ESTIMATE = EstimateResource(
    number=1,
    created=datetime(2026, 11, 23, 14, 3, tzinfo=UTC),
    seconds=2.1,
    summary=CalibrationSummary(kind="hand-eye", images=12, used=12, estimated=True, position_sigma_mm=0.41),
    artefacts=[
        ArtefactResource(
            name="hand_eye.json", bytes=5120, sha256=_SHA256, href=f"{_SESSION_PATH}/estimates/1/hand_eye.json"
        )
    ],
    links={"session": _SESSION_PATH},
)
CALIBRATION_VALUES: tuple[BaseModel, ...] = (
    BoardRecipe(kind="hand-eye", target_mm=0.3),
    _KIND,
    Page[CalibrationKindResource](items=[_KIND]),
    _ESTIMATE,
    Page[EstimateResource](items=[_ESTIMATE]),
    TargetView(
        frame=17, width_px=1024, height_px=1024, seen=True, why_not="", corners_px=[(412.31, 388.04)], corners=48
    ),
    PlannedViews(
        width_px=1024,
        height_px=1024,
        estimate=0,
        next=0,
        views=[
            PlannedView(
                number=0,
                reason="expected error after this view: 0.41 mm rms",
                taken=False,
                view=ExpectedView(
                    outline_px=[(301.5, 280.2), (640.1, 301.7), (610.9, 566.0), (288.4, 540.6)],
                    corners_px=[(340.2, 318.8)],
                    corners=48,
                    distance_m=0.52,
                    tilt_deg=31.0,
                ),
            )
        ],
        links={"pass": f"{_SESSION_PATH}/passes/1", "session": _SESSION_PATH},
    ),
)
