"""Fault injection: the faults that the control port can order.

Every fault is one entry of `FAULTS`; its parameters are the other fields of the request, and any other field is
refused. Faults act between two ticks: at once, after `at_s` seconds of wall time, or as soon as the `at_move`-th move
from now has begun; a request may state only one of the two.

    safety      protective_stop · safeguard_stop · emergency_stop · system_emergency_stop · violation · fault
                release_safeguard_stop · release_emergency_stop · clear (normal, powered and without faults at once)
    operation   power_off · program_stop · program_pause (as from the pendant) · local_mode · remote_mode
                speed_slider {fraction} · hand_move {joints: [6], seconds} (by hand; 0: at once, without a path)
                restart (all connections end, booting, then without power; also switches on what was shut down)
    arm         joint_offset {offsets_rad: [6]} (true minus reported joints) · time_jump {seconds}
    outputs     output_stuck {output, level: true | false | null = let go}
    links       cut {port} · stall {port, seconds} · half_packet (RTDE clients get half a packet, then the end)
                delay {port, latency_ms, jitter_ms, seed} (both ways; 0 ends it)
    world       lamp {fraction, flicker} (0: dead, though its output is on) · dropped_frame {count}
                saturated_frame {count} · nudged_object {shift_m: [3], turn_rad}
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import JOINT_LIMIT
from hardware_sim.controller.modes import SafetyMode
from hardware_sim.controller.signals import DIGITAL_OUTPUTS


class FaultError(ValueError):
    """The request is not a valid fault; the message says what is wrong."""


class Links(Protocol):
    """The ports, as far as faults reach them; see `server.Server`."""

    def numbers(self) -> list[int]: ...
    def cut(self, port: int) -> None: ...
    def stall(self, port: int, seconds: float) -> None: ...
    def send_half_a_packet(self) -> None: ...
    def delay(self, port: int, latency: float, jitter: float, seed: int) -> None: ...
    def restart(self) -> None: ...


Parameters = Mapping[str, Any]
Action = Callable[[], object]
Maker = Callable[[Controller, Links, Parameters], Action]
"""Checks a request's parameters and returns the action."""


@dataclass(frozen=True)
class Fault:
    """One kind of fault."""

    make: Maker
    takes: tuple[str, ...] = ()
    """Names of its parameters."""


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


def _optional(parameters: Parameters, name: str, default: float, least: float, most: float) -> float:
    return number({name: default, **parameters}, name, least, most)


def _delay(controller: Controller, links: Links, parameters: Parameters) -> Action:
    latency, jitter = (_optional(parameters, name, 0.0, 0.0, 10_000.0) / 1e3 for name in ("latency_ms", "jitter_ms"))
    seed = int(_optional(parameters, "seed", 0, 0, 2**31))
    return partial(links.delay, _port(parameters, links), latency, jitter, seed)


def _lamp(controller: Controller, links: Links, parameters: Parameters) -> Action:
    fraction, flicker = (_optional(parameters, *of, 0.0, 1.0) for of in (("fraction", 1.0), ("flicker", 0.0)))
    return partial(controller.disturbances.light, fraction, flicker)


def _output_stuck(controller: Controller, links: Links, parameters: Parameters) -> Action:
    output = int(number(parameters, "output", 0, DIGITAL_OUTPUTS - 1))
    level = parameters.get("level")
    if level is not None and not isinstance(level, bool):
        raise FaultError(f"level must be true, false or null, not {level!r}")
    return partial(controller.outputs.stick, output, level)


def _order(action: Callable[[Controller], object]) -> Fault:
    """A fault without parameters."""
    return Fault(lambda controller, links, parameters: partial(action, controller))


_DEMAND = "fault on demand"
FAULTS: dict[str, Fault] = {
    "protective_stop": _order(lambda c: c.protective_stop(_DEMAND)),
    "safeguard_stop": _order(lambda c: c.safeguard_stop(_DEMAND)),
    "release_safeguard_stop": _order(lambda c: c.safety.release_safeguard()),
    "emergency_stop": _order(lambda c: c.emergency_stop(_DEMAND)),
    "system_emergency_stop": _order(lambda c: c.emergency_stop(_DEMAND, SafetyMode.SYSTEM_EMERGENCY_STOP)),
    "release_emergency_stop": _order(lambda c: c.safety.release_emergency_stop()),
    "violation": _order(lambda c: c.emergency_stop(_DEMAND, SafetyMode.VIOLATION)),
    "fault": _order(lambda c: c.emergency_stop(_DEMAND, SafetyMode.FAULT)),
    "power_off": _order(Controller.power_off),
    "program_stop": _order(lambda c: c.stop_program("at the pendant")),
    "program_pause": _order(Controller.pause),
    "local_mode": _order(lambda c: setattr(c.safety, "remote_control", False)),
    "remote_mode": _order(lambda c: setattr(c.safety, "remote_control", True)),
    "output_stuck": Fault(_output_stuck, ("output", "level")),
    "speed_slider": Fault(
        lambda c, _, given: partial(setattr, c, "slider", number(given, "fraction", 0.0, 1.0)), ("fraction",)
    ),
    "joint_offset": Fault(
        lambda c, _, given: partial(c.offset_joints, vector(given, "offsets_rad", 6, 1.0)), ("offsets_rad",)
    ),
    "hand_move": Fault(
        lambda c, _, given: partial(
            c.move_by_hand, vector(given, "joints", 6, JOINT_LIMIT), _optional(given, "seconds", 1.0, 0.0, 3600.0)
        ),
        ("joints", "seconds"),
    ),
    "restart": Fault(lambda _, links, given: links.restart),
    "clear": _order(Controller.clear),
    "cut": Fault(lambda _, links, given: partial(links.cut, _port(given, links)), ("port",)),
    "stall": Fault(
        lambda _, links, given: partial(links.stall, _port(given, links), number(given, "seconds", 0.0, 3600.0)),
        ("port", "seconds"),
    ),
    "half_packet": Fault(lambda _, links, given: links.send_half_a_packet),
    "delay": Fault(_delay, ("port", "latency_ms", "jitter_ms", "seed")),
    "lamp": Fault(_lamp, ("fraction", "flicker")),
    "dropped_frame": Fault(
        lambda c, _, given: partial(c.disturbances.drop, int(_optional(given, "count", 1, 1, 1e6))), ("count",)
    ),
    "saturated_frame": Fault(
        lambda c, _, given: partial(c.disturbances.saturate, int(_optional(given, "count", 1, 1, 1e6))), ("count",)
    ),
    "nudged_object": Fault(
        lambda c, _, given: partial(
            c.nudge_object, vector(given, "shift_m", 3, 1.0), _optional(given, "turn_rad", 0.0, -math.tau, math.tau)
        ),
        ("shift_m", "turn_rad"),
    ),
    "time_jump": Fault(lambda c, _, given: partial(c.jump, number(given, "seconds", 0.0, 1e6)), ("seconds",)),
}

_WHEN = ("at_s", "at_move")
"""Parameters of every fault."""


def prepare(controller: Controller, links: Links, request: Parameters) -> None:
    """Checks a fault request and carries it out: now, after `at_s` seconds, or when the `at_move`-th move begins.

    Raises FaultError.
    """
    kind = request.get("kind")
    fault = FAULTS.get(kind) if isinstance(kind, str) else None
    if fault is None:
        raise FaultError(f"kind must be one of {', '.join(sorted(FAULTS))}, not {kind!r}")
    takes = (*fault.takes, *_WHEN)
    if unknown := request.keys() - {"command", "kind", *takes}:
        raise FaultError(f"{kind} takes {', '.join(takes)}, not {', '.join(sorted(unknown))}")
    if all(name in request for name in _WHEN):
        raise FaultError(f"give {' or '.join(_WHEN)}, not both")
    action = fault.make(controller, links, request)
    if "at_s" in request:
        due = controller.now + number(request, "at_s", 0.0, 86400.0)
        controller.order(lambda: controller.now >= due, action)
    elif "at_move" in request:
        moves = controller.arm.moves_started + int(number(request, "at_move", 1, 1e6))
        controller.order(lambda: controller.arm.moves_started >= moves, action)
    else:
        action()
