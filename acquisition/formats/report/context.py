"""What the report says beside the maps: where the lights stood, what was chosen, predicted and measured."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from acquisition.models.base import FloatArray


@dataclass(frozen=True)
class ReportContext:
    """What a report is told of one result."""

    title: str
    names: tuple[str, ...]
    """Of each image (F)."""
    directions: FloatArray
    """(F, 3) unit vectors from the object to the lights, view frame."""
    groups: tuple[str, ...] = ()
    """For each image what its light was taken for, such as `pilot` and `planned`; none: nothing to tell apart."""
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
