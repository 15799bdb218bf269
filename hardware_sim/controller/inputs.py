"""Digital and analogue inputs: a test sets them at the control port, as wires would; programs and clients read them."""


class Inputs:
    """Levels as bits, 0–7 standard, 8–15 configurable, 16–17 tool; analogue values, 0–1 standard, 2–3 tool."""

    def __init__(self) -> None:
        self.levels = 0
        self.analog = [0.0] * 4  # V, or A where the input is set to current
        self.analog_is_voltage = [True] * 4

    def set_level(self, number: int, level: bool) -> None:
        """Sets a digital input."""
        self.levels = (self.levels & ~(1 << number)) | level << number
