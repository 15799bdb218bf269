"""Mosaic sensors, and the colour calibration of a camera under the lamp."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from acquisition.models.base import Value, Vector3

Mosaic = Literal["rggb", "bggr", "grbg", "gbrg"]
"""Channels of a mosaic (Bayer) sensor's upper left 2 × 2 sites, row by row, as GenICam's pixel formats name them."""

_BAYER: dict[str, Mosaic] = {"BayerRG": "rggb", "BayerBG": "bggr", "BayerGR": "grbg", "BayerGB": "gbrg"}


def mosaic_of(pixel_format: str) -> Mosaic | None:
    """The mosaic that a pixel format of GenICam states, such as BayerRG12; none: it is monochrome."""
    return _BAYER.get(pixel_format[:7])


WHITE_TOLERANCE = 1e-3
"""Largest deviation of `ColourCalibration.white`'s mean from 1: what rounding of a file leaves."""

Matrix3x3 = Annotated[tuple[Vector3, Vector3, Vector3], Field(strict=False)]


class ColourCalibration(Value):
    """White balance and colour matrix of the camera under the lamp.

    An albedo is the channels' values over those of a white surface (`white`), times `matrix`: linear values of sRGB's
    primaries (IEC 61966-2-1), white D65. `lamp_intensity` is that of the mean over a 2 × 2 cell, R + 2 G + B over four,
    so the same mean of `white` is 1.
    """

    white: Vector3 = Field(description="Factors of R, G, B: values on a white surface over their mean, (R + 2 G + B)/4")
    matrix: Matrix3x3 = Field(description="Factors that give linear sRGB from white-balanced R, G, B")
    delta_e_mean: float = Field(ge=0, description="CIEDE2000 of the chart's patches, mean")
    delta_e_max: float = Field(ge=0, description="CIEDE2000 of the chart's patches, largest")
    chart: str = Field(description="Reference values that it was fitted to")

    @model_validator(mode="after")
    def _is_relative(self) -> "ColourCalibration":
        """Refuses values of white that are not relative to their mean."""
        red, green, blue = self.white
        if min(self.white) <= 0 or abs((red + 2 * green + blue) / 4 - 1) > WHITE_TOLERANCE:
            raise ValueError("white must be positive, and (R + 2 G + B)/4 of it 1")
        return self
