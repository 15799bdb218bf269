"""Force mode and the search for contact against a spring surface, without sockets."""

import pytest

from hardware_sim.controller import poses
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.force import MOST_FORCE, SpringSurface
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RuntimeState, SafetyMode
from tests.hardware_sim.controller.programs import HOME, TICK

STIFFNESS = 5000.0  # N/m
DOWN = "p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,-20,0,0,0], 2, [0.1,0.1,0.2,1,1,1]"


def started(lines: str, depth: float | None = None) -> Controller:
    """A controller that runs lines, with a level surface `depth` m below its tool."""
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    if depth is not None:
        x, y, z = poses.position(controller.arm.base_from_tool)
        controller.arm.touch(SpringSurface((x, y, z - depth), (0.0, 0.0, 1.0), STIFFNESS))
    controller.load(f"def f():\n{lines}\nend\n")
    return controller


def run(controller: Controller, seconds: float) -> Controller:
    """Lets so much time pass, or less where the program ends before."""
    for _ in range(round(seconds / TICK)):
        controller.tick(controller.ticks * TICK)
        if controller.runtime_state is RuntimeState.STOPPED and not controller.arm.moving:
            break
    return controller


def height(controller: Controller) -> float:
    return poses.position(controller.arm.base_from_tool)[2]


def floats(controller: Controller, count: int) -> list[float]:
    return [controller.registers.get(f"output_double_register_{i}")[0] for i in range(count)]


def test_force_mode_in_free_space_moves_along_free_axis() -> None:
    controller = started(f" force_mode({DOWN})\n sleep(1)\n end_force_mode()\n write_output_float_register(0, force())")
    x, y, z = poses.position(controller.arm.base_from_tool)
    run(controller, 5.0)
    assert poses.position(controller.arm.base_from_tool)[:2] == pytest.approx((x, y), abs=1e-6)
    assert height(controller) == pytest.approx(z - 0.2, abs=0.02)  # at the limit of 0.2 m/s
    assert floats(controller, 1) == [0.0]


def test_force_mode_on_surface_settles_at_wrench() -> None:
    lines = f""" force_mode({DOWN})
 sleep(1)
 write_output_float_register(0, force())
 f = get_tcp_force()
 write_output_float_register(1, f[2])
 end_force_mode()
 movel(pose_add(get_actual_tcp_pose(), p[0, 0, 0.05, 0, 0, 0]))
 write_output_float_register(2, force())"""
    controller = started(lines, depth=0.01)
    surface = height(controller) - 0.01
    run(controller, 10.0)
    assert controller.runtime_state is RuntimeState.STOPPED, list(controller.messages)
    assert floats(controller, 3) == pytest.approx([20.0, 20.0, 0.0], abs=0.1)
    assert height(controller) == pytest.approx(surface - 20.0 / STIFFNESS + 0.05, abs=2e-5)


def test_force_is_published() -> None:
    controller = run(started(f" force_mode({DOWN})\n sleep(60)", depth=0.01), 0.3)
    published = controller.registers.get("actual_TCP_force")
    assert list(published) == list(controller.arm.tool_force)
    assert published[2] == controller.registers.get("tcp_force_scalar")[0] > 10.0


def test_force_mode_ends_with_program() -> None:
    controller = run(started(f" force_mode({DOWN})\n sleep(0.5)"), 5.0)
    assert controller.runtime_state is RuntimeState.STOPPED
    assert not controller.arm.moving


def test_move_in_force_mode_is_refused_by_name() -> None:
    controller = run(started(f" force_mode({DOWN})\n movej([0,0,0,0,0,0])"), 5.0)
    assert any("movej: a move in force mode is not simulated" in m for m in controller.messages)


def test_tool_contact_leads_back_to_just_before_contact() -> None:
    lines = """ steps = 0
 while steps == 0:
  speedl([0, 0, -0.05, 0, 0, 0], 0.5, 0.002)
  steps = tool_contact([0, 0, -1, 0, 0, 0])
 end
 write_output_float_register(0, tool_contact([0, 0, 1, 0, 0, 0]))
 write_output_float_register(1, tool_contact([0, 0, 0, 0, 0, 0]))
 q = get_actual_joint_positions_history(steps)
 stopl(3)
 movel(q)"""
    controller = started(lines, depth=0.03)
    surface = height(controller) - 0.03
    run(controller, 10.0)
    assert controller.runtime_state is RuntimeState.STOPPED, list(controller.messages)
    assert floats(controller, 2) == [0.0, 1.0]
    assert height(controller) == pytest.approx(surface, abs=1.0 / STIFFNESS)


def test_push_beyond_force_limit_is_protective_stop() -> None:
    controller = run(started(" movel(pose_add(get_actual_tcp_pose(), p[0, 0, -0.1, 0, 0, 0]))", depth=0.02), 5.0)
    assert controller.safety.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert "the tool pushes with" in controller.messages[-1]
    assert controller.arm.pressure >= MOST_FORCE
