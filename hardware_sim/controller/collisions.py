"""Record of the simulated arm's collisions, which are checked in every step of its motion and kept for grading."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hardware_sim.controller.kinematics import ArmModel

if TYPE_CHECKING:
    from hardware_sim.controller.contact import Contact, ContactCheck
    from hardware_sim.controller.surroundings import Surroundings

_KEPT = 1000


@dataclass(frozen=True)
class Collision:
    """A contact: the controller's time stamp, s, the two parts, and the true joints (6,) in rad."""

    timestamp: float
    first: str
    second: str
    joints: tuple[float, ...]

    @property
    def parts(self) -> str:
        """Both parts, in words."""
        return f"{self.first} touches {self.second}"


class Collisions:
    """The collisions of one arm. Without surroundings nothing is solid, not even the arm itself."""

    def __init__(self, model: ArmModel) -> None:
        self.records: deque[Collision] = deque(maxlen=_KEPT)
        self.count = 0
        self.touching: tuple[str, str] | None = None
        self._model = model
        self._check: ContactCheck | None = None
        self._surroundings: Surroundings | None = None
        self._known: set[tuple[str, str]] = set()  # met since the arm was last free
        self._check_at_rest = True

    def surround(self, path: Path) -> None:
        """Reads the arm's surroundings from a file. Raises OSError, ValueError."""
        # Imported here, because NumPy would double the start-up time of a controller without surroundings.
        from hardware_sim.controller.surroundings import load  # noqa: PLC0415

        self._surround(load(path))

    def nudge_object(self, shift_m: Sequence[float], turn_rad: float) -> None:
        """Moves the object by (3,) m and turns it about its own axis."""
        if self._surroundings is not None:
            self._surround(self._surroundings.nudged(shift_m, turn_rad))

    def _surround(self, surroundings: "Surroundings") -> None:
        from hardware_sim.controller.contact import ContactCheck  # noqa: PLC0415

        self._surroundings = surroundings
        self._check = ContactCheck(self._model, surroundings)
        self.reset()

    def reset(self) -> None:
        """Forgets the present contacts when the arm may run again, so that they count as new ones."""
        self._known.clear()
        self._check_at_rest = True
        if self._check is not None:
            self._check.reset()

    def advance(self, joints: Sequence[float], timestamp: float) -> Collision | None:
        """Follows the arm to its true joints (6,); returns a collision that has begun."""
        contact = None if self._check is None else self._check.advance(joints)
        self._check_at_rest = False
        if contact is None:
            self.touching = None
            self._known.clear()
            return None
        return self._record(contact, timestamp)

    @property
    def due(self) -> bool:
        """Whether a check is due although the arm stands still."""
        return self._check_at_rest and self._check is not None

    def _record(self, contact: "Contact", timestamp: float) -> Collision | None:
        self.touching = (contact.first, contact.second)
        if self.touching in self._known:
            return None
        self._known.add(self.touching)
        self.count += 1
        collision = Collision(timestamp, contact.first, contact.second, contact.joints)
        self.records.append(collision)
        return collision
