"""What a report states beside the maps: light directions, solver, predicted σ, errors and times."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from acquisition.models.base import FloatArray


@dataclass(frozen=True)
class ReportContext:
    """Title, lights, solver and figures of one result, for its report."""

    title: str
    names: tuple[str, ...]
    """Of each image (F)."""
    directions: FloatArray
    """(F, 3) unit vectors from the object to the lights, view frame."""
    groups: tuple[str, ...] = ()
    """For each image the group of its light, such as `pilot` and `planned`; none: one group."""
    solver: str = ""
    why: str = ""
    """Why that solver."""
    seconds: Mapping[str, float] = field(default_factory=dict[str, float])
    predicted_sigma_deg: float | None = None
    """Mean σ that the plan expected."""
    error_deg: Mapping[str, float] = field(default_factory=dict[str, float])
    """Errors against known truth: mean, median, 95 %; empty where no truth is known."""
    drawings: tuple[tuple[str, str], ...] = ()
    """Of how the images were taken: what each shows, and an SVG element."""
    warnings: tuple[str, ...] = ()
    """Sentences that whoever read the images has for the person."""
    calibration_checked: str = ""
    """When the calibration was checked, and with which result; empty: no cell of its own is known."""
