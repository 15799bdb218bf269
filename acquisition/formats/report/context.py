"""Contents of a report beside the maps: light directions, solver, predicted σ, errors and times."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from acquisition.models.base import FloatArray


@dataclass(frozen=True)
class ReportContext:
    """Title, lights, solver and figures of one result, for its report."""

    title: str
    names: tuple[str, ...]  # of each image (F)
    directions: FloatArray  # (F, 3) unit vectors from the object to the lights, view frame
    groups: tuple[str, ...] = ()  # of each image's light, such as `pilot` and `planned`; none: one group
    solver: str = ""
    why: str = ""  # why that solver was chosen
    seconds: Mapping[str, float] = field(default_factory=dict[str, float])
    facing_sigma_deg: float | None = None  # mean σ of the pixels that the plan counts; none: not evaluated
    predicted_sigma_deg: float | None = None  # mean σ that the plan expected of them
    error_deg: Mapping[str, float] = field(default_factory=dict[str, float])  # against known truth; empty: none is
    drawings: tuple[tuple[str, str], ...] = ()  # how the images were taken: what each shows, and an SVG element
    intensities: str = "calibrated"  # how the lamps' intensities were known: calibrated, stated, assumed
    warnings: tuple[str, ...] = ()  # sentences of the images' reader
    calibration_checked: str = ""  # when, and with which result; empty: no cell of its own is known
