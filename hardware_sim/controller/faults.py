"""Fault injection: the faults that the control port can order.

Every fault is one entry of `FAULTS`; its parameters are the other fields of the request. Faults act between two ticks:
at once, after `at_s` seconds of wall time, or as soon as the `at_move`-th move from now has begun.

    safety      protective_stop · safeguard_stop · emergency_stop · system_emergency_stop · violation · fault
                release_safeguard_stop · release_emergency_stop · clear (all is normal, powered and mended at once)
    operation   power_off · program_stop · program_pause (as from the pendant) · local_mode · remote_mode
                speed_slider {fraction} · hand_move {joints: [6], seconds} (by hand; 0: at once, without a path)
                restart (all connections end, booting, then without power; also switches on what was shut down)
    arm         joint_offset {offsets_rad: [6]} (the arm is not where it says) · time_jump {seconds}
    outputs     output_stuck {output, level: true | false | null = let go}
    links       cut {port} · stall {port, seconds} · half_packet (RTDE clients get half a packet, then the end)
                delay {port, latency_ms, jitter_ms, seed} (both ways; 0 ends it)
    world       lamp {fraction, flicker} (0: dead, though its output is on) · dropped_frame {count}
                saturated_frame {count} · nudged_object {shift_m: [3], turn_rad}
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import JOINT_LIMIT
from hardware_sim.controller.modes import SafetyMode
from hardware_sim.controller.outputs import DIGITAL_OUTPUTS
from hardware_sim.controller.script_values import STEP_TIME


class FaultError(ValueError):
    """The request is not a fault that exists; the message says what is wrong."""


class Links(Protocol):
    """The ports, as far as faults reach them."""

    def numbers(self) -> list[int]:
        """The ports that can be cut or stalled."""
        ...

    def cut(self, port: int) -> None:
        """Closes all connections of a port."""
        ...

    def stall(self, port: int, seconds: float) -> None:
        """Freezes a port for a time."""
        ...

    def send_half_a_packet(self) -> None:
        """Sends half a data packet to RTDE clients and hangs up."""
        ...

    def delay(self, port: int, latency: float, jitter: float, seed: int) -> None:
        """Holds back all bytes of a port, both ways, by `latency` + up to `jitter` seconds."""
        ...

    def restart(self) -> None:
        """Ends all connections and starts the controller anew."""
        ...


Parameters = Mapping[str, Any]
Action = Callable[[], None]


def number(parameters: Parameters, name: str, least: float, most: float) -> float:
    """A number among the fields of a request. Raises FaultError."""
    value = parameters.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise FaultError(f"{name} must be a number from {least:g} to {most:g}, not {value!r}")
    return float(value)


def vector(parameters: Parameters, name: str, count: int, most: float) -> list[float]:
    """A list of numbers among the fields of a request. Raises FaultError."""
    values = parameters.get(name)
    if not isinstance(values, list) or len(values) != count:
        raise FaultError(f"{name} must be {count} numbers, not {values!r}")
    return [number({name: value}, name, -most, most) for value in values]


def _port(parameters: Parameters, links: Links) -> int:
    port = int(number(parameters, "port", 1, 65535))
    if port not in links.numbers():
        raise FaultError(f"port must be one of {links.numbers()}, not {port}")
    return port


def _cut(controller: Controller, links: Links, parameters: Parameters) -> Action:
    port = _port(parameters, links)
    return lambda: links.cut(port)


def _stall(controller: Controller, links: Links, parameters: Parameters) -> Action:
    port, seconds = _port(parameters, links), number(parameters, "seconds", 0.0, 3600.0)
    return lambda: links.stall(port, seconds)


def _half_packet(controller: Controller, links: Links, parameters: Parameters) -> Action:
    return links.send_half_a_packet


def _delay(controller: Controller, links: Links, parameters: Parameters) -> Action:
    port = _port(parameters, links)
    latency, jitter = (
        number({"latency_ms": 0.0, "jitter_ms": 0.0, **parameters}, n, 0.0, 10_000.0) / 1e3
        for n in ("latency_ms", "jitter_ms")
    )
    seed = int(number({"seed": 0, **parameters}, "seed", 0, 2**31))
    return lambda: links.delay(port, latency, jitter, seed)


def _restart(controller: Controller, links: Links, parameters: Parameters) -> Action:
    return links.restart


def _hand_move(controller: Controller, links: Links, parameters: Parameters) -> Action:
    joints = vector(parameters, "joints", 6, JOINT_LIMIT)
    seconds = number({"seconds": 1.0, **parameters}, "seconds", 0.0, 3600.0)
    return lambda: controller.move_by_hand(joints, seconds)


def _lamp(controller: Controller, links: Links, parameters: Parameters) -> Action:
    given = {"fraction": 1.0, "flicker": 0.0, **parameters}
    fraction, flicker = number(given, "fraction", 0.0, 1.0), number(given, "flicker", 0.0, 1.0)

    def act() -> None:
        controller.disturbances.lamp_fraction, controller.disturbances.lamp_flicker = fraction, flicker

    return act


def _frames(name: str) -> Callable[[Controller, Links, Parameters], Action]:
    def make(controller: Controller, links: Links, parameters: Parameters) -> Action:
        count = int(number({"count": 1, **parameters}, "count", 1, 1e6))
        disturbances = controller.disturbances
        return lambda: setattr(disturbances, name, getattr(disturbances, name) + count)

    return make


def _nudged_object(controller: Controller, links: Links, parameters: Parameters) -> Action:
    shift = vector(parameters, "shift_m", 3, 1.0)
    turn = number({"turn_rad": 0.0, **parameters}, "turn_rad", -math.tau, math.tau)

    def act() -> None:
        disturbances = controller.disturbances
        disturbances.object_shift_m = [a + b for a, b in zip(disturbances.object_shift_m, shift, strict=True)]
        disturbances.object_turn_rad += turn
        controller.collisions.nudge_object(shift, turn)

    return act


def _time_jump(controller: Controller, links: Links, parameters: Parameters) -> Action:
    seconds = number(parameters, "seconds", 0.0, 1e6)

    def act() -> None:
        controller.ticks += round(seconds / STEP_TIME)

    return act


def _remote(remote: bool) -> Callable[[Controller, Links, Parameters], Action]:
    def make(controller: Controller, links: Links, parameters: Parameters) -> Action:
        def act() -> None:
            controller.safety.remote_control = remote

        return act

    return make


def _output_stuck(controller: Controller, links: Links, parameters: Parameters) -> Action:
    output = int(number(parameters, "output", 0, DIGITAL_OUTPUTS - 1))
    level = parameters.get("level")
    if level is not None and not isinstance(level, bool):
        raise FaultError(f"level must be true, false or null, not {level!r}")
    return lambda: controller.outputs.stick(output, level)


def _speed_slider(controller: Controller, links: Links, parameters: Parameters) -> Action:
    fraction = number(parameters, "fraction", 0.0, 1.0)

    def act() -> None:
        controller.slider = fraction

    return act


def _joint_offset(controller: Controller, links: Links, parameters: Parameters) -> Action:
    offsets = vector(parameters, "offsets_rad", 6, 1.0)

    def act() -> None:
        controller.arm.joint_offset = offsets
        controller.collisions.reset()

    return act


def _order(action: Callable[[Controller], object]) -> Callable[[Controller, Links, Parameters], Action]:
    def make(controller: Controller, links: Links, parameters: Parameters) -> Action:
        def act() -> None:
            action(controller)

        return act

    return make


FAULTS: dict[str, Callable[[Controller, Links, Parameters], Action]] = {
    "protective_stop": _order(lambda c: c.protective_stop("fault on demand")),
    "safeguard_stop": _order(lambda c: c.safeguard_stop("fault on demand")),
    "release_safeguard_stop": _order(lambda c: c.safety.release_safeguard()),
    "emergency_stop": _order(lambda c: c.emergency_stop("fault on demand")),
    "system_emergency_stop": _order(lambda c: c.emergency_stop("fault on demand", SafetyMode.SYSTEM_EMERGENCY_STOP)),
    "release_emergency_stop": _order(lambda c: c.safety.release_emergency_stop()),
    "violation": _order(lambda c: c.emergency_stop("fault on demand", SafetyMode.VIOLATION)),
    "fault": _order(lambda c: c.emergency_stop("fault on demand", SafetyMode.FAULT)),
    "power_off": _order(lambda c: c.power_off()),
    "program_stop": _order(lambda c: c.stop_program("at the pendant")),
    "program_pause": _order(lambda c: c.pause()),
    "local_mode": _remote(False),
    "remote_mode": _remote(True),
    "output_stuck": _output_stuck,
    "speed_slider": _speed_slider,
    "joint_offset": _joint_offset,
    "hand_move": _hand_move,
    "restart": _restart,
    "clear": _order(lambda c: c.clear()),
    "cut": _cut,
    "stall": _stall,
    "half_packet": _half_packet,
    "delay": _delay,
    "lamp": _lamp,
    "dropped_frame": _frames("dropped_frames"),
    "saturated_frame": _frames("saturated_frames"),
    "nudged_object": _nudged_object,
    "time_jump": _time_jump,
}


def prepare(controller: Controller, links: Links, request: Parameters) -> None:
    """Checks a fault request and carries it out: now, after `at_s` seconds, or when the `at_move`-th move begins.

    Raises FaultError.
    """
    kind = request.get("kind")
    make = FAULTS.get(kind) if isinstance(kind, str) else None
    if make is None:
        raise FaultError(f"kind must be one of {', '.join(sorted(FAULTS))}, not {kind!r}")
    action = make(controller, links, request)
    if "at_s" in request:
        due = controller.now + number(request, "at_s", 0.0, 86400.0)
        controller.order(lambda: controller.now >= due, action)
    elif "at_move" in request:
        moves = controller.arm.moves_started + int(number(request, "at_move", 1, 1e6))
        controller.order(lambda: controller.arm.moves_started >= moves, action)
    else:
        action()
