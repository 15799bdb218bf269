"""State of the faults of lamp, camera and object, which are ordered at the control port and applied by the world."""

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class Disturbances:
    """The world's present faults; frames are counted since the start, so that each fault happens once."""

    lamp_fraction: float = 1.0  # of the lamp's light; 0: the lamp is dead, whatever its output
    lamp_flicker: float = 0.0  # depth, 0–1, of random differences between exposures
    dropped_frames: int = 0
    saturated_frames: int = 0
    object_shift_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    object_turn_rad: float = 0.0

    def light(self, fraction: float = 1.0, flicker: float = 0.0) -> None:
        """Sets the lamp, or restores it; a nudged object stays where it is."""
        self.lamp_fraction, self.lamp_flicker = fraction, flicker

    def drop(self, frames: int) -> None:
        """Makes the camera lose this many more frames."""
        self.dropped_frames += frames

    def saturate(self, frames: int) -> None:
        """Saturates this many more frames."""
        self.saturated_frames += frames

    def nudge(self, shift_m: Sequence[float], turn_rad: float) -> None:
        """Moves the object further by (3,) m, and turns it further about its own axis."""
        self.object_shift_m = [a + b for a, b in zip(self.object_shift_m, shift_m, strict=True)]
        self.object_turn_rad += turn_rad
