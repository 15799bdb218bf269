"""Steps of jogging: where they lead, how fast, and what stops them."""

import numpy as np
import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.jog import JogMotion
from acquisition.waypoints import kinematics
from acquisition.waypoints.collision import scene
from acquisition.waypoints.jog_step import JOG_SPEED_RAD_S, JOG_TOOL_SPEED_M_S, jog_step
from hardware_sim import nominal

CELL = cell_config.load(nominal.default_cell_file())
CALIBRATION = nominal.calibration(64)
HOME = CELL.arm.home


def flange(joints: tuple[float, ...]) -> np.ndarray:
    return kinematics.forward(kinematics.arm_model(CELL.arm.model), np.array([joints]))[0, 6]


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("direction", [-1, 1])
def test_jog_step_turns_one_joint(joint: int, direction: int) -> None:
    path = jog_step(HOME, JogMotion(joint=joint, direction=direction, step_rad=0.05), CELL, CALIBRATION)

    turn = np.array(path.path[-1]) - HOME
    assert turn[joint] == pytest.approx(0.05 * direction)
    assert np.count_nonzero(turn) == 1
    assert 0 < path.speeds[0] <= JOG_SPEED_RAD_S


@pytest.mark.parametrize(("axis", "number"), [("x", 0), ("y", 1), ("z", 2)])
def test_jog_step_moves_tool_along_axis(axis: str, number: int) -> None:
    path = jog_step(HOME, JogMotion(axis=axis, direction=1, step_m=0.02), CELL, CALIBRATION)  # type: ignore[arg-type]

    before, after = flange(HOME), flange(path.path[-1])
    moved = after[:3, 3] - before[:3, 3]
    assert moved == pytest.approx(0.02 * np.eye(3)[number], abs=1e-6)
    assert np.allclose(after[:3, :3], before[:3, :3], atol=1e-6)
    assert np.linalg.norm(moved) / path.seconds <= JOG_TOOL_SPEED_M_S


def test_jog_step_goes_down_until_table_and_no_further() -> None:
    joints, steps, refused = HOME, [], None
    while refused is None and len(steps) < 200:
        try:
            path = jog_step(joints, JogMotion(axis="z", direction=-1), CELL, CALIBRATION)
        except RigError as error:
            refused = error
            continue
        steps.append(flange(joints)[2, 3] - flange(path.path[-1])[2, 3])
        joints = path.path[-1]

    arm = scene(CELL, CALIBRATION)
    assert refused is not None
    assert refused.code is ErrorCode.WAYPOINTS_COLLISION
    assert refused.context["reason"] in ("hits-table", "hits-object", "self-collision")
    assert steps[0] == pytest.approx(0.03)
    assert steps[-1] < steps[0]  # the last ones are shorter
    assert arm.free(np.array([joints]))[0]
    back = jog_step(joints, JogMotion(axis="z", direction=1), CELL, CALIBRATION)
    assert flange(back.path[-1])[2, 3] > flange(joints)[2, 3]


def test_jog_step_at_joint_limit_is_refused_and_comes_back() -> None:
    joints = (*HOME[:5], HOME[5] + np.pi - 0.001)

    with pytest.raises(RigError) as refused:
        jog_step(joints, JogMotion(joint=5, direction=1), CELL, CALIBRATION)
    back = jog_step(joints, JogMotion(joint=5, direction=-1), CELL, CALIBRATION)

    assert refused.value.code is ErrorCode.WAYPOINTS_UNREACHABLE
    assert (refused.value.context["reason"], refused.value.context["joint"]) == ("joint-limit", 5)
    assert back.path[-1][5] == pytest.approx(joints[5] - 0.1)


def test_jog_step_from_within_clearance_is_refused() -> None:
    inside = next(
        joints
        for joints in np.random.default_rng(0).uniform(-2, 2, (500, 6))
        if not scene(CELL, CALIBRATION).free(joints[None])[0]
    )
    with pytest.raises(RigError) as refused:
        jog_step(tuple(inside.tolist()), JogMotion(joint=0, direction=1, step_rad=0.001), CELL, CALIBRATION)
    assert refused.value.code is ErrorCode.WAYPOINTS_COLLISION


@pytest.mark.parametrize(
    "wrong", [{}, {"joint": 1, "axis": "x"}, {"joint": 6}, {"axis": "w"}, {"joint": 0, "step_rad": 1.0}]
)
def test_jog_motion_invalid_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="validation error"):
        JogMotion.model_validate({"direction": 1, **wrong})
