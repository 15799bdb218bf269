"""Digital and analogue inputs and outputs, with the installation's setting "low when not running".

A test sets inputs at the control port, in place of wires; programs and clients read them.

The lamp is switched by an output with that setting, as on a real controller. The setting switches the lamp off when the
program, the driver or the service dies.
"""

from collections.abc import Iterable

DIGITAL_OUTPUTS = 18  # 0–7 standard, 8–15 configurable, 16–17 tool
_VOLTS = 10.0
_LEAST_AMPERES, _MOST_AMPERES = 0.004, 0.020


class Inputs:
    """Levels as bits, 0–7 standard, 8–15 configurable, 16–17 tool; analogue values, 0–1 standard, 2–3 tool."""

    def __init__(self) -> None:
        self.levels = 0
        self.analog = [0.0] * 4  # V, or A if the input is set to current
        self.analog_is_voltage = [True] * 4

    def set_level(self, number: int, level: bool) -> None:
        self.levels = (self.levels & ~(1 << number)) | level << number


class Outputs:
    """Levels as bits, the time of each output's last change, and the levels at which outputs are stuck."""

    def __init__(self, low_when_stopped: Iterable[int], now: float) -> None:
        self.levels = 0
        self.changed_at = [now] * DIGITAL_OUTPUTS
        self.stuck: dict[int, bool] = {}
        self.analog_ratio = [0.0, 0.0]
        self.analog_is_voltage = [True, True]
        self.tool_voltage = 0  # V
        self.flags: dict[int, bool] = {}
        self._requested = 0
        self._low_mask = sum(1 << n for n in set(low_when_stopped))
        self._playing = False
        self._now = now

    def write(self, mask: int, levels: int) -> None:
        """Sets the outputs in `mask`."""
        self._requested = (self._requested & ~mask) | (levels & mask)
        self._apply()

    def set_bit(self, number: int, level: bool) -> None:
        self.write(1 << number, int(level) << number)

    def hold_low_when_stopped(self, number: int, low: bool) -> None:
        """Makes an output go low whenever no program plays, or keep its level."""
        self._low_mask = (self._low_mask & ~(1 << number)) | low << number

    def stick(self, number: int, level: bool | None) -> None:
        """Holds an output at a level, whatever is written; None releases it."""
        if level is None:
            self.stuck.pop(number, None)
        else:
            self.stuck[number] = level
        self._apply()

    def tick(self, now: float, playing: bool) -> None:
        """Takes the present time, and applies a change of whether a program plays."""
        self._now = now
        if playing != self._playing:
            self._playing = playing
            self._apply()

    def _apply(self) -> None:
        if not self._playing:
            # Cleared, not masked: the output must not come back by itself with the next program.
            self._requested &= ~self._low_mask
        levels = self._requested
        for number, level in self.stuck.items():
            levels = levels | 1 << number if level else levels & ~(1 << number)
        changed = levels ^ self.levels
        self.levels = levels
        for number in range(DIGITAL_OUTPUTS):
            if changed >> number & 1:
                self.changed_at[number] = self._now

    def analog(self, number: int) -> float:
        """An analogue output as reported: V, or A if it is set to current."""
        ratio = self.analog_ratio[number]
        if self.analog_is_voltage[number]:
            return ratio * _VOLTS
        return _LEAST_AMPERES + ratio * (_MOST_AMPERES - _LEAST_AMPERES)
