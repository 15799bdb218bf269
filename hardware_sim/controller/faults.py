"""Faults on demand: what the control port can make go wrong.

Every fault is one entry of `FAULTS`; its parameters are the other fields of the request. Faults act between two ticks:
at once, after `at_s` seconds of wall time, or as soon as the `at_move`-th move from now has begun.

    protective_stop · safeguard_stop · emergency_stop · system_emergency_stop · violation · fault · power_off
    release_safeguard_stop · release_emergency_stop · clear (everything normal again, at once)
    program_stop · program_pause (as from the pendant) · local_mode · remote_mode
    output_stuck {output, level: true | false | null = let go} · speed_slider {fraction}
    joint_offset {offsets_rad: [6]} (the arm is not where it says) · time_jump {seconds}
    cut {port} · stall {port, seconds} · half_packet (RTDE clients get half a packet, then the end of the connection)
"""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.modes import SafetyMode
from hardware_sim.controller.outputs import DIGITAL_OUTPUTS


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


Parameters = Mapping[str, Any]
Action = Callable[[], None]


def _number(parameters: Parameters, name: str, least: float, most: float) -> float:
    value = parameters.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise FaultError(f"{name} must be a number from {least:g} to {most:g}, not {value!r}")
    return float(value)


def _port(parameters: Parameters, links: Links) -> int:
    port = int(_number(parameters, "port", 1, 65535))
    if port not in links.numbers():
        raise FaultError(f"port must be one of {links.numbers()}, not {port}")
    return port


def _cut(controller: Controller, links: Links, parameters: Parameters) -> Action:
    port = _port(parameters, links)
    return lambda: links.cut(port)


def _stall(controller: Controller, links: Links, parameters: Parameters) -> Action:
    port, seconds = _port(parameters, links), _number(parameters, "seconds", 0.0, 3600.0)
    return lambda: links.stall(port, seconds)


def _half_packet(controller: Controller, links: Links, parameters: Parameters) -> Action:
    return links.send_half_a_packet


def _time_jump(controller: Controller, links: Links, parameters: Parameters) -> Action:
    seconds = _number(parameters, "seconds", 0.0, 1e6)
    return lambda: controller.jump_in_time(seconds)


def _remote(remote: bool) -> Callable[[Controller, Links, Parameters], Action]:
    def make(controller: Controller, links: Links, parameters: Parameters) -> Action:
        def act() -> None:
            controller.remote_control = remote

        return act

    return make


def _output_stuck(controller: Controller, links: Links, parameters: Parameters) -> Action:
    output = int(_number(parameters, "output", 0, DIGITAL_OUTPUTS - 1))
    level = parameters.get("level")
    if level is not None and not isinstance(level, bool):
        raise FaultError(f"level must be true, false or null, not {level!r}")
    return lambda: controller.outputs.stick(output, level)


def _speed_slider(controller: Controller, links: Links, parameters: Parameters) -> Action:
    fraction = _number(parameters, "fraction", 0.0, 1.0)

    def act() -> None:
        controller.slider = fraction

    return act


def _joint_offset(controller: Controller, links: Links, parameters: Parameters) -> Action:
    offsets = parameters.get("offsets_rad")
    if not isinstance(offsets, list) or len(offsets) != 6:
        raise FaultError(f"offsets_rad must be six numbers, not {offsets!r}")
    values = [_number({"offsets_rad": v}, "offsets_rad", -1.0, 1.0) for v in offsets]

    def act() -> None:
        controller.arm.joint_offset = values

    return act


def _simple(action: Callable[[Controller], object]) -> Callable[[Controller, Links, Parameters], Action]:
    def make(controller: Controller, links: Links, parameters: Parameters) -> Action:
        def act() -> None:
            action(controller)

        return act

    return make


FAULTS: dict[str, Callable[[Controller, Links, Parameters], Action]] = {
    "protective_stop": _simple(lambda c: c.protective_stop("fault on demand")),
    "safeguard_stop": _simple(lambda c: c.safeguard_stop("fault on demand")),
    "release_safeguard_stop": _simple(lambda c: c.release_safeguard()),
    "emergency_stop": _simple(lambda c: c.emergency_stop("fault on demand")),
    "system_emergency_stop": _simple(lambda c: c.emergency_stop("fault on demand", SafetyMode.SYSTEM_EMERGENCY_STOP)),
    "release_emergency_stop": _simple(lambda c: c.release_emergency_stop()),
    "violation": _simple(lambda c: c.emergency_stop("fault on demand", SafetyMode.VIOLATION)),
    "fault": _simple(lambda c: c.emergency_stop("fault on demand", SafetyMode.FAULT)),
    "power_off": _simple(lambda c: c.power_off()),
    "program_stop": _simple(lambda c: c.stop_program("at the pendant")),
    "program_pause": _simple(lambda c: c.pause()),
    "local_mode": _remote(False),
    "remote_mode": _remote(True),
    "output_stuck": _output_stuck,
    "speed_slider": _speed_slider,
    "joint_offset": _joint_offset,
    "clear": _simple(lambda c: c.clear()),
    "cut": _cut,
    "stall": _stall,
    "half_packet": _half_packet,
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
        due = controller.now + _number(request, "at_s", 0.0, 86400.0)
        controller.order(lambda: controller.now >= due, action)
    elif "at_move" in request:
        number = controller.arm.moves_started + int(_number(request, "at_move", 1, 1e6))
        controller.order(lambda: controller.arm.moves_started >= number, action)
    else:
        action()
