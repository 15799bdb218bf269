"""Result of a colour calibration as its file holds it; `colour.json`."""

from typing import Annotated, Literal

from pydantic import Field

from acquisition.models.base import Value, Vector3
from acquisition.models.colour import ColourCalibration


class PatchResult(Value):
    """One patch of the chart."""

    name: str
    reference_lab: Vector3 = Field(description="Stated CIELAB under D50")
    found_lab: Vector3 = Field(description="CIELAB under D50 after white balance and matrix, mean over the images")
    delta_e: float = Field(description="CIEDE2000 between the two")


class ColourResult(Value):
    """White balance and colour matrix, found on a 24-patch chart; `colour.json`."""

    kind: Literal["colour"] = "colour"
    made_at: str
    version: str = Field(description="Version of the software")
    colour: ColourCalibration
    held_out_delta_e: float | None = Field(
        description="Mean CIEDE2000 of images, each left out of the fit in turn; none: there is one image"
    )
    patches: Annotated[tuple[PatchResult, ...], Field(strict=False)]
    images: dict[str, str] = Field(description="SHA-256 of each image")
