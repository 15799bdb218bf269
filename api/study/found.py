"""What a study draws and what it found, as values."""

from dataclasses import dataclass

from api.study.curves import Curve, Draws, Sample
from api.study.paper import Errata, Placement
from api.study.three import Row


@dataclass(frozen=True)
class Scale:
    """How much is drawn: pixels of the error curves, draws by number of images, random triples, draws of the table."""

    pixels: int
    matt: Draws
    glossy: Draws
    triples: int
    table_draws: int


@dataclass(frozen=True)
class Study:
    """What was found."""

    seed: int
    quick: bool
    scale: Scale
    seconds: float
    placements: list[Placement]
    errata: Errata
    table: list[Row]
    samples: list[Sample]
    matt: list[Curve]
    glossy: list[Curve]
