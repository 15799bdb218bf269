"""The result of a study, which `run` measures, `page` shows and `study.json` holds."""

from dataclasses import dataclass

from api.cli.study.error_curves import Curve, Sample, Scale
from api.cli.study.paper_criterion import Errata, Placement
from api.cli.study.three_images import Row


@dataclass(frozen=True)
class StudyResult:
    """All measurements of one study."""

    seed: int
    quick: bool
    scale: Scale
    seconds: float
    placements: list[Placement]
    errata: Errata
    table: list[Row]
    samples: list[Sample]
    diffuse: list[Curve]
    glossy: list[Curve]
