"""Real-Time Data Exchange (UR RTDE guide), protocol version 2, port 30004: recipes, owned registers, data at 500 Hz.

A frame is a big-endian uint16 size, a uint8 type and the payload. Nothing is ever sent between a request and its reply,
because clients read exactly one frame and take it as the reply. For the same reason texts reach only clients that have
started. An impossible request is refused in its reply; bad frames are logged and ignored. Only a size below the
header's ends the connection, since no later frame could be delimited. Set-ups are refused until version 2 is agreed
upon: a real controller would take them as version 1, whose frames differ.
"""

import logging
import math
import operator
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from hardware_sim.controller import dynamics
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.registers import INPUT_TYPES, OFFSETS, OUTPUT_TYPES, TYPES
from hardware_sim.controller.sockets import Connection

LOG = logging.getLogger("hardware_sim.controller")
PORT = 30004
FREQUENCY = 500.0  # Hz
_HEADER = struct.Struct(">HB")
_MOST_RECIPES = 255
_LONGEST_LIST = 2048  # bytes of names in one set-up, a limit of the protocol's guide
_REFUSED = b"\x00"
_SOURCE = b"Controller"


class Kind(IntEnum):
    """Types of frames."""

    PROTOCOL = ord("V")
    VERSION = ord("v")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")
    DATA = ord("U")
    TEXT = ord("M")


class Level(IntEnum):
    """Severity of a text message."""

    EXCEPTION = 0
    ERROR = 1
    WARNING = 2
    INFO = 3


@dataclass(frozen=True)
class OutputRecipe:
    """An output recipe of one client: how to pick its values from the flat list and how to pack them.

    The list's last value is picked too and left out again, because a getter of a single value would return no tuple.
    """

    names: tuple[str, ...]
    pick: Callable[[Sequence[float]], tuple[float, ...]]
    layout: struct.Struct
    dynamic: bool

    def pack(self, values: Sequence[float]) -> bytes:
        """A data frame with the present values."""
        return self.layout.pack(self.layout.size, Kind.DATA, 1, *self.pick(values)[:-1])


@dataclass(frozen=True)
class InputRecipe:
    """An input recipe of one client: its layout, the slots of registers, and outputs by name."""

    names: frozenset[str]
    layout: struct.Struct
    registers: tuple[tuple[int, int, int], ...]  # first value, slot, count
    others: tuple[tuple[int, str], ...]  # value, name


def _split(payload: bytes) -> list[str]:
    """The names of a list; none if it is longer than allowed."""
    if len(payload) > _LONGEST_LIST:
        LOG.warning("RTDE list of %d bytes refused: at most %d are allowed", len(payload), _LONGEST_LIST)
        return []
    # ur_rtde ends its lists with a comma; UR's own client does not.
    return [name for name in payload.decode("latin-1").split(",") if name]


def text_frame(text: str, level: Level) -> bytes:
    """A text message, cut to 255 bytes, because its length is a single byte."""
    message = text.encode()[:255].decode(errors="ignore").encode()  # without half a character at the end
    payload = bytes([len(message)]) + message + bytes([len(_SOURCE)]) + _SOURCE + bytes([level])
    return _HEADER.pack(_HEADER.size + len(payload), Kind.TEXT) + payload


def read_text(payload: bytes) -> str:
    """A client's text message with its source and level. Raises ValueError if it is cut short."""
    source_at = 1 + payload[0] if payload else 0
    level_at = source_at + 1 + payload[source_at] if 0 < source_at < len(payload) else len(payload)
    if level_at >= len(payload):
        raise ValueError("the text message is cut short")
    message, source = payload[1:source_at], payload[source_at + 1 : level_at]
    names = {level.value: level.name for level in Level}
    level = names.get(payload[level_at], str(payload[level_at]))
    return f"{level} of {source.decode(errors='replace')!r}: {message.decode(errors='replace')!r}"


class RtdeConnection(Connection):
    """One RTDE client."""

    def __init__(self, stream: socket.socket, controller: Controller, owners: dict[str, object]) -> None:
        """`owners` maps each input to the connection that owns it, of all clients; freed when that closes."""
        super().__init__(stream)
        self.started = False
        self.output: OutputRecipe | None = None
        self.frequency = FREQUENCY
        self._controller = controller
        self._owners = owners
        self._agreed = False
        self._inputs: list[InputRecipe] = []
        self._buffer = b""

    def ended(self) -> None:
        """Frees its inputs at once, because the library reconnects within milliseconds."""
        for name in [name for name, owner in self._owners.items() if owner is self]:
            del self._owners[name]

    def received(self, data: bytes) -> None:
        """Splits into frames."""
        buffer = self._buffer + data
        at = 0
        while len(buffer) - at >= _HEADER.size:
            size, kind = _HEADER.unpack_from(buffer, at)
            if size < _HEADER.size:
                LOG.warning("RTDE frame of size %d: connection closed", size)
                self.closed = True
                return
            if len(buffer) - at < size:
                break
            self._frame(kind, buffer[at + _HEADER.size : at + size])
            at += size
        self._buffer = buffer[at:]

    @property
    def reads_dynamics(self) -> bool:
        """Whether it receives any of the variables that `dynamics` computes."""
        return self.started and self.output is not None and self.output.dynamic

    def due(self, ticks: int) -> bool:
        """Whether this tick's values go to the client: `frequency` of 500 ticks a second do, evenly spread."""
        packets = ticks * self.frequency // FREQUENCY
        return self.started and packets != (ticks - 1) * self.frequency // FREQUENCY

    def _reply(self, kind: Kind, payload: bytes) -> None:
        self.send(_HEADER.pack(_HEADER.size + len(payload), kind) + payload)

    def _frame(self, kind: int, payload: bytes) -> None:
        if kind == Kind.DATA:
            self._data(payload)
        elif kind == Kind.PROTOCOL:
            accepted = payload == b"\x00\x02"
            self._agreed = self._agreed or accepted
            self._reply(Kind.PROTOCOL, bytes([accepted]))
        elif kind == Kind.VERSION:
            self._reply(Kind.VERSION, struct.pack(">4I", *self._controller.version))
        elif kind in (Kind.OUTPUTS, Kind.INPUTS) and not self._agreed:
            LOG.warning("RTDE set-up refused: the client has not asked for protocol version 2")
            self._reply(Kind(kind), _REFUSED)
        elif kind == Kind.OUTPUTS:
            self._set_outputs(payload)
        elif kind == Kind.INPUTS:
            self._set_inputs(payload)
        elif kind in (Kind.START, Kind.PAUSE):
            self._reply(Kind(kind), b"\x01")
            self.started = kind == Kind.START
        elif kind == Kind.TEXT:
            try:
                LOG.info("RTDE text: %s", read_text(payload))
            except ValueError as error:
                LOG.warning("RTDE text ignored: %s", error)
        else:
            LOG.warning("RTDE frame of unknown type %d", kind)

    def _set_outputs(self, payload: bytes) -> None:
        self.output = None
        frequency = struct.unpack_from(">d", payload)[0] if len(payload) >= 8 else math.nan
        names = _split(payload[8:])
        types = [OUTPUT_TYPES.get(name, "NOT_FOUND") for name in names]
        answer = ",".join(types).encode()
        if not frequency > 0.0 or not names or "NOT_FOUND" in types:
            LOG.warning("RTDE outputs refused: %r at %g Hz", names, frequency)
            self._reply(Kind.OUTPUTS, _REFUSED + answer)
            return
        slots = [OFFSETS[n] + i for n, t in zip(names, types, strict=True) for i in range(TYPES[t][1])]
        layout = struct.Struct(">HBB" + "".join(TYPES[t][0] for t in types))
        dynamic = not dynamics.VARIABLES.isdisjoint(names)
        self.output = OutputRecipe(tuple(names), operator.itemgetter(*slots, -1), layout, dynamic)
        if frequency > FREQUENCY:
            LOG.warning("RTDE outputs at %g Hz instead of %g Hz", FREQUENCY, frequency)
        self.frequency = min(frequency, FREQUENCY)
        self._reply(Kind.OUTPUTS, b"\x01" + answer)

    def _set_inputs(self, payload: bytes) -> None:
        names = _split(payload)
        held = [name for name in names if self._owners.get(name, self) is not self]
        types = ["IN_USE" if name in held else INPUT_TYPES.get(name, "NOT_FOUND") for name in names]
        answer = ",".join(types).encode()
        if not names or len(self._inputs) >= _MOST_RECIPES or "IN_USE" in types or "NOT_FOUND" in types:
            LOG.warning("RTDE inputs refused: %r are %r", names, types)
            self._reply(Kind.INPUTS, _REFUSED + answer)
            return
        self._owners.update(dict.fromkeys(names, self))
        registers: list[tuple[int, int, int]] = []
        others: list[tuple[int, str]] = []
        at = 0
        for name, kind in zip(names, types, strict=True):
            count = TYPES[kind][1]
            if name in OFFSETS:
                registers.append((at, OFFSETS[name], count))
            else:
                others.append((at, name))
            at += count
        layout = struct.Struct(">" + "".join(TYPES[t][0] for t in types))
        self._inputs.append(InputRecipe(frozenset(names), layout, tuple(registers), tuple(others)))
        self._reply(Kind.INPUTS, bytes([len(self._inputs)]) + answer)

    def _data(self, payload: bytes) -> None:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(self._inputs):
            LOG.warning("RTDE data for an input recipe %d that was not set up", number)
            return
        recipe = self._inputs[number - 1]
        if len(payload) - 1 != recipe.layout.size:
            # The library does send packets longer than their recipe; their first bytes count.
            LOG.info("RTDE data of %d bytes for recipe %d, which has %d", len(payload) - 1, number, recipe.layout.size)
            if len(payload) - 1 < recipe.layout.size:
                return
        values = recipe.layout.unpack_from(payload, 1)
        slots = self._controller.registers.values
        for at, slot, count in recipe.registers:
            slots[slot : slot + count] = values[at : at + count]
        if recipe.others:
            apply_outputs(self._controller, {name: values[at] for at, name in recipe.others})
        self._controller.watchdogs.feed(recipe.names, time.monotonic())


def apply_outputs(controller: Controller, written: dict[str, Any]) -> None:
    """Applies a packet's values of outputs and the speed slider."""
    outputs = controller.outputs
    for bank, first, width in (("standard", 0, 8), ("configurable", 8, 8), ("tool", 16, 2)):
        mask, levels = f"{bank}_digital_output_mask", f"{bank}_digital_output"
        if mask in written and levels in written:
            lines = written[mask] & ((1 << width) - 1)
            outputs.write(lines << first, written[levels] << first)
    if written.get("speed_slider_mask", 0) & 1:
        fraction = written.get("speed_slider_fraction", math.nan)
        if 0.0 <= fraction <= 1.0:
            controller.slider = fraction
        else:
            LOG.warning("speed slider left at %g: %g is outside 0 to 1", controller.slider, fraction)
    mask = written.get("standard_analog_output_mask", 0)
    for number in (0, 1):
        ratio = written.get(f"standard_analog_output_{number}", math.nan)
        if not mask >> number & 1:
            continue
        if 0.0 <= ratio <= 1.0:
            outputs.analog_ratio[number] = ratio
            outputs.analog_is_voltage[number] = bool(written.get("standard_analog_output_type", 0) >> number & 1)
        else:
            LOG.warning("analogue output %d left unchanged: %g is outside 0 to 1", number, ratio)


def broadcast(connections: Sequence[RtdeConnection], controller: Controller) -> None:
    """Sends the tick's values to every started client that is due; equal recipes are packed once."""
    packed: dict[tuple[str, ...], bytes] = {}
    values = controller.registers.values
    for connection in connections:
        recipe = connection.output
        if recipe is None or not connection.due(controller.ticks):
            continue
        data = packed.get(recipe.names)
        if data is None:
            data = packed[recipe.names] = recipe.pack(values)
        connection.offer(data)


def announce(connections: Sequence[RtdeConnection], message: str) -> None:
    """Sends a program's runtime exception to every started client."""
    frame = text_frame(message, Level.EXCEPTION)
    for connection in connections:
        if connection.started:
            connection.offer(frame)


def send_half_a_packet(connections: Sequence[RtdeConnection], controller: Controller) -> None:
    """Sends each started client the first half of a packet and ends its connection."""
    for connection in connections:
        if connection.output is not None and connection.started:
            data = connection.output.pack(controller.registers.values)
            connection.offer(data[: len(data) // 2])
            connection.closed = True
