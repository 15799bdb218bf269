"""State of the faults of lamp, camera and object: ordered at the control port, carried out by the world."""

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass
class Disturbances:
    """The world's present faults; frames are counted since the start, so that each fault happens once."""

    lamp_fraction: float = 1.0  # of the lamp's light; 0: it is dead, whatever its output says
    lamp_flicker: float = 0.0  # depth 0–1 by which exposures differ at random
    dropped_frames: int = 0
    saturated_frames: int = 0
    object_shift_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    object_turn_rad: float = 0.0

    def reset_lamp(self) -> None:
        """Restores the lamp; a nudged object stays where it is."""
        self.lamp_fraction, self.lamp_flicker = 1.0, 0.0

    def as_json(self) -> dict[str, Any]:
        """For the control port."""
        return asdict(self)
