"""Examples of every request and response body for the OpenAPI description: one session in a small cell.

They are instances of the models, so that an example can never contradict its schema. A person sees what a body looks
like, and a test generator starts from valid values.
"""

from datetime import UTC, datetime, timedelta
from typing import Any

from pydantic import BaseModel

from acquisition.models import calibration_check
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.calibration_check import CheckRecord
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.errors import ErrorCode
from acquisition.models.light_forecast import LightForecast, PlacedLight
from acquisition.models.light_plan import ForecastPoint, Light, LightPlan, PriorForecast
from acquisition.models.problem_table import PROBLEMS
from acquisition.models.recipe import Recipe
from acquisition.models.result import ResultSummary, SolveSettings
from acquisition.models.route import Route, Waypoint
from acquisition.models.shot import FrameQuality, FrameRef, Shot, ShotKey
from acquisition.models.time_left import TimeLeft, TimePart
from acquisition.session import Stage
from acquisition.session_state import ARM_STATE, State
from api.rest import images
from api.rest.calibration import (
    CalibrationChoice,
    CalibrationSetResource,
    RigCalibration,
    ToolResource,
    ToolStatement,
)
from api.rest.jog import JogRequest, JogResource
from api.rest.joint_readings import JointReadingResource
from api.rest.key_schemas import CallerResource, KeyResource, TicketResource
from api.rest.keys import Role
from api.rest.openapi_calibration_examples import CALIBRATION_VALUES
from api.rest.openapi_queue_examples import QUEUE_VALUES
from api.rest.openapi_scene_example import SCENE
from api.rest.preview_figures import PreviewFigures
from api.rest.rig_schemas import (
    ArmResource,
    CalibrationResource,
    Fault,
    Health,
    ReadingResource,
    Reason,
    RecoveryRequest,
    RigResource,
    SafetyResource,
)
from api.rest.schemas import (
    Accepted,
    ActionAccepted,
    ActionRequest,
    ActionResource,
    ArtefactResource,
    DryRunResource,
    EventResource,
    OwnLights,
    Page,
    PassResource,
    PassSummary,
    Problem,
    ProblemPage,
    RegionResource,
    ResolveAccepted,
    ResolveRequest,
    ResultResource,
    SessionEdit,
    SessionResource,
    ShotResource,
)

_ID = "20261121-101500-3f9c2a"
_SESSION_PATH = f"/v1/sessions/{_ID}"
_CREATED_AT = datetime(2026, 11, 21, 10, 15, tzinfo=UTC)
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_POSE = ((1.0, 0.0, 0.0, 0.42), (0.0, -1.0, 0.0, 0.1), (0.0, 0.0, -1.0, 0.45), (0.0, 0.0, 0.0, 1.0))
_JOINTS = (3.14, -1.6, 1.8, -1.77, -1.57, 1.57)
_OTHER_JOINTS = (2.61, -1.42, 1.71, -1.86, -1.57, 1.04)
_LIGHT = Light(position=(0.12, 0.05, -0.47), axis=(-0.26, -0.11, -0.96))
_RECIPE = Recipe(label="coin, obverse")


def _problem(code: ErrorCode, detail: str, **context: Any) -> Problem:
    return Problem.of(code, detail, context, _SESSION_PATH)


_STOPPED = _problem(ErrorCode.ARM_PROTECTIVE_STOP, "The controller reports a protective stop")
_FAULT = Fault(
    code=_STOPPED.code, detail=_STOPPED.detail, remedy=_STOPPED.remedy, since=_CREATED_AT + timedelta(seconds=40)
)
_RESULT = ResultResource(
    number=1,
    passes=[0, 1],
    settings=SolveSettings(),
    created=_CREATED_AT + timedelta(seconds=70),
    seconds=1.9,
    summary=ResultSummary(
        images=8,
        object_pixels=181_204,
        solved_pixels=180_990,
        mean_sigma_deg=0.71,
        median_sigma_deg=0.6,
        predicted_sigma_deg=0.68,
        predicted_median_deg=0.52,
        fewer_than_three_lights=0.001,
        intensity_factors=[1.0, 0.99, 1.01, 1.0, 1.0, 1.0, 0.99, 1.01],
        noise={"read": 0.0012, "intensity": 0.01},
    ),
    artefacts=[
        ArtefactResource(
            name="normals.png", bytes=2_402_113, sha256=_SHA256, href=f"{_SESSION_PATH}/results/1/normals.png"
        )
    ],
    exports={"mesh.ply": f"{_SESSION_PATH}/results/1/mesh.ply"},
    links={
        "self": f"{_SESSION_PATH}/results/1",
        "manifest": f"{_SESSION_PATH}/results/1/manifest.json",
        "session": _SESSION_PATH,
    },
)
_SESSION = SessionResource(
    id=_ID,
    number=12,
    state=State.RUNNING,
    arm=ARM_STATE[State.RUNNING],
    stage=Stage.CAPTURE,
    progress=0.42,
    seconds_left=38.0,
    time_left=TimeLeft(
        seconds=38.0,
        at_least=False,
        parts=[
            TimePart(work="images", count=5, seconds=28.0, rests_on="this-session"),
            TimePart(work="normals", count=1, seconds=10.0, rests_on="earlier-sessions"),
        ],
    ),
    reason=None,
    allowed_actions=["pause", "stop"],
    recipe=_RECIPE,
    label=_RECIPE.label,
    notes=_RECIPE.notes,
    cell="simulated cell",
    created=_CREATED_AT,
    started=_CREATED_AT + timedelta(seconds=5),
    ended=None,
    answer=None,
    links={
        "self": _SESSION_PATH,
        "actions": f"{_SESSION_PATH}/actions",
        "events": f"/v1/events?session_id={_ID}&after=0",
        "passes": f"{_SESSION_PATH}/passes",
        "results": f"{_SESSION_PATH}/results",
    },
)
_PASS = PassSummary(
    number=0, method="optimal", lights=4, shots=5, predicted_sigma_deg=None, links={"self": f"{_SESSION_PATH}/passes/0"}
)
_PLAN = LightPlan(lights=[_LIGHT], method="optimal", reasons=["the smallest slant that can be reached"])
_ROUTE = Route(
    start=_JOINTS,
    waypoints=[Waypoint(light=_LIGHT, path=[_OTHER_JOINTS], speeds=[1.05], seconds=0.9)],
    light_numbers=[0],
    home_path=[_JOINTS],
    home_speeds=[1.05],
    seconds=1.8,
    lower_bound_s=1.8,
)
_KEY = KeyResource(name="anna", role=Role.OPERATOR, created=_CREATED_AT, last_used=_CREATED_AT + timedelta(days=2))
_CALIBRATION = Calibration(
    width=1024,
    height=1024,
    camera_matrix=((4600.0, 0.0, 511.5), (0.0, 4600.0, 511.5), (0.0, 0.0, 1.0)),
    distortion=(-0.08, 0.05, 0.0004, -0.0003, 0.0),
    base_from_camera=_POSE,
    tool_from_lamp=_POSE,
    lamp_intensity=20.0,
    reference_m=0.45,
    lobe_exponent=0.8,
    sensor=SensorModel(bits=12, gain_e_per_dn=2.5, read_noise_e=5.0, full_well_e=10077.5, black_level_dn=64.0),
    intensity_sigma=0.01,
    lamp_position_sigma_m=0.001,
    made_at="2026-11-01T00:00:00Z",
    valid_days=90.0,
)
_FORECAST = PriorForecast(
    points=[
        ForecastPoint(added=images, lights=images, sigma_deg=sigma_deg)
        for images, sigma_deg in ((4, 11.1), (8, 0.85), (16, 0.64))
    ],
    assumption="Nothing is known of the object before the first image, so a matt sphere of 110 mm is assumed.",
)
_SHOT = Shot(
    key=ShotKey(pass_number=0, number=0),
    kind="light",
    frame=FrameRef(path="passes/0/shots/0.tiff", width=1024, height=1024, sha256=_SHA256),
    exposure_s=0.04,
    light_number=0,
    light=_LIGHT,
    joints=_OTHER_JOINTS,
    base_from_tool=_POSE,
    lamp_on=True,
    arm_time_s=4021.5,
    taken_at=(_CREATED_AT + timedelta(seconds=12)).timestamp(),
    quality=FrameQuality(saturated=0.0, bright_level=0.81, accepted=True),
)
_ACTION = ActionResource(action="start", actor="lab@127.0.0.1", outcome="running", at=_CREATED_AT)

_SET = CalibrationSetResource(
    id=_ID,
    active=False,
    fits="",
    fingerprint=_SHA256,
    made_at="2026-11-23T14:00:00Z",
    kind="hand-eye",
    camera="pylon 40012345",
    arm="UR5 20235500001",
    summary=CalibrationSummary(
        kind="hand-eye",
        images=20,
        used=20,
        estimated=True,
        focal_px=4597.2,
        corner_sigma_px=0.05,
        projection_sigma_px=0.12,
        position_sigma_mm=0.31,
        rotation_sigma_deg=0.03,
        arm_sigma_mm=0.03,
        square_scale=1.0003,
        fingerprint=_SHA256,
    ),
    links={"hand_eye.json": f"/v1/rig/calibrations/{_ID}/hand_eye.json"},
)
_CHECK = calibration_check.state(
    {
        "board": CheckRecord(
            session=_ID, made_at="2026-11-23T07:40:00Z", fingerprint=_SHA256, passed=True, probability=0.41,
            changed=(), sentences=(),
        )
    },
    _SHA256,
    datetime(2026, 11, 23, 9, 40, tzinfo=UTC),
)  # fmt: skip

VALUES: tuple[BaseModel, ...] = (
    _RECIPE,
    Recipe(target_sigma_deg=0.7, max_lights=16),
    ActionRequest(action="start"),
    SessionEdit(label="coin, reverse", answer=1),
    OwnLights(lights=[(0.12, 0.05, -0.47), (-0.08, 0.14, -0.49)]),
    RecoveryRequest(step="unlock"),
    ResolveRequest(settings=SolveSettings(robust=False), last_pass=0),
    Accepted(links={"rig": "/v1/rig", "events": "/v1/events"}),
    ActionAccepted(state=State.RUNNING, links={"session": _SESSION_PATH}),
    DryRunResource(plan=_PLAN, route=_ROUTE, seconds=2.4, forecast=_FORECAST),
    EventResource(
        id=4711,
        session_id=_ID,
        type="session.state",
        at=_CREATED_AT,
        body={"from": "created", "state": "running", "by": "lab@127.0.0.1"},
    ),
    Health(),
    LightForecast(
        lights=[PlacedLight(position=_LIGHT.position, refusal=None, gain=0.06)],
        sigma_before_deg=1.9,
        sigma_deg=0.8,
        median_deg=0.6,
        brightest_sigma_deg=6.5,
    ),
    JogRequest(hold="press-0f3a91c2", joint=5, direction=1),
    JogResource(moving=True, hold_s=0.3, links={"release": "/v1/rig/jog/release", "stop": "/v1/rig/stop"}),
    JointReadingResource(connected=True, joints=_JOINTS, moving=False, age_s=0.0018, at=_CREATED_AT),
    Page[ActionResource](items=[_ACTION]),
    Page[KeyResource](items=[_KEY]),
    Page[PassSummary](items=[_PASS]),
    Page[ResultResource](items=[_RESULT]),
    Page[SessionResource](items=[_SESSION], next="/v1/sessions?limit=1&after=12"),
    PassResource(
        number=0,
        plan=_PLAN,
        route=_ROUTE,
        shots=[ShotResource(shot=_SHOT, links=images.links(f"{_SESSION_PATH}/passes/0", _SHOT))],
        gain_pictures=[],
        links={"self": f"{_SESSION_PATH}/passes/0", "session": _SESSION_PATH},
    ),
    PreviewFigures(
        frame=118,
        taken_at=_CREATED_AT,
        exposure_s=0.04,
        width_px=1024,
        height_px=1024,
        area="keep-out",
        histogram=[1200, 5300, 9100, *[700] * 60, 12],
        bin_width_dn=64.0,
        black_level_dn=64.0,
        saturated=0.0,
        black=0.004,
        bright_level=0.52,
        focus=0.41,
    ),
    _problem(ErrorCode.RIG_BUSY, f"Session {_ID} holds the rig", holder=_ID),
    ProblemPage(
        code=ErrorCode.RIG_BUSY,
        status=PROBLEMS[ErrorCode.RIG_BUSY].status,
        title=PROBLEMS[ErrorCode.RIG_BUSY].title,
        remedy=PROBLEMS[ErrorCode.RIG_BUSY].remedy,
    ),
    *QUEUE_VALUES,
    RegionResource(pixels=52_113, links={"self": f"{_SESSION_PATH}/region.png", "session": _SESSION_PATH}),
    ResolveAccepted(number=2, links={"result": f"{_SESSION_PATH}/results/2", "session": _SESSION_PATH}),
    _RESULT,
    RigResource(
        version="0.2.0",
        cell="simulated cell",
        fingerprint=_SHA256,
        arm_model="ur5e",
        arm_address="127.0.0.1",
        arm=ArmResource(model="UR5", serial="20235500001", software="5.12.0"),
        connected=True,
        driver_priority="real-time",
        tool="lamp",
        camera_ready=True,
        reading=ReadingResource(
            joints=_JOINTS,
            joint_speeds=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            base_from_tool=_POSE,
            robot_mode=7,
            safety_bits=1,
            program_running=True,
            speed_fraction=1.0,
            age_s=0.0018,
        ),
        holder=None,
        may_start=False,
        reasons=[Reason(code=_STOPPED.code, detail=_STOPPED.detail, remedy=_STOPPED.remedy)],
        calibration=CalibrationResource(
            made_at="2026-11-01T00:00:00Z", valid_until="2027-01-30T00:00:00+00:00", valid=True, check=_CHECK
        ),
        faults=[_FAULT],
        links={"self": "/v1/rig", "stop": "/v1/rig/stop"},
    ),
    SafetyResource(
        clear=False, connected=True, faults=[_FAULT], links={"acknowledgement": "/v1/rig/safety/acknowledgement"}
    ),
    SCENE,
    _SESSION,
    CallerResource(name="anna", role=Role.OPERATOR),
    _KEY,
    CalibrationChoice(id=_ID),
    ToolStatement(tool="board"),
    ToolResource(tool="board", links={"self": "/v1/rig/tool", "rig": "/v1/rig"}),
    _SET,
    Page[CalibrationSetResource](items=[_SET], next=None),
    *CALIBRATION_VALUES,
    RigCalibration(
        id="cell",
        made_at="2026-11-01T00:00:00Z",
        valid_until="2027-01-30T00:00:00+00:00",
        valid=True,
        check=_CHECK,
        age_days=22.4,
        file="calibration.json",
        fingerprint=_SHA256,
        values=_CALIBRATION,
        links={"self": "/v1/rig/calibration", "rig": "/v1/rig"},
    ),
    TicketResource(ticket="uM3vC0c4mJ7hT6m3i3rQbq0t4bXn2lW6", good_until=_CREATED_AT + timedelta(minutes=5)),
)


def add_to(schemas: dict[str, Any]) -> None:
    """Adds each example to the schema of its type in an OpenAPI description."""
    for value in VALUES:
        name = type(value).__name__.replace("[", "_").replace("]", "_")
        schemas[name].setdefault("examples", []).append(value.model_dump(mode="json"))
