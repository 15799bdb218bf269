"""Mosaic sensors, and the colour calibration of a camera under the lamp."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from acquisition.models.base import Value, Vector3

Mosaic = Literal["rggb", "bggr", "grbg", "gbrg"]
"""Channels of the upper left 2 × 2 sites of a mosaic (Bayer) sensor, row by row, as in GenICam's pixel formats."""

_BAYER: dict[str, Mosaic] = {"BayerRG": "rggb", "BayerBG": "bggr", "BayerGR": "grbg", "BayerGB": "gbrg"}


def mosaic_of(pixel_format: str) -> Mosaic | None:
    """Returns the mosaic of a GenICam pixel format such as BayerRG12; None: the format is monochrome."""
    return _BAYER.get(pixel_format[:7])


WHITE_TOLERANCE = 1e-3
"""Largest accepted deviation of the mean of `ColourCalibration.white` from 1, to allow for rounding in files."""

Matrix3x3 = Annotated[tuple[Vector3, Vector3, Vector3], Field(strict=False)]


class ColourCalibration(Value):
    """White balance and colour matrix of the camera under the lamp.

    The albedo is the channels' values divided by those of a white surface (`white`), then multiplied by `matrix`. It is
    linear, with sRGB's primaries (IEC 61966-2-1) and white D65. `lamp_intensity` is that of the mean over a 2 × 2 cell,
    (R + 2 G + B)/4, so the same mean of `white` is 1.
    """

    white: Vector3 = Field(
        description="Factors of R, G, B: values on a white surface divided by their mean, (R + 2 G + B)/4"
    )
    matrix: Matrix3x3 = Field(description="Factors that give linear sRGB from white-balanced R, G, B")
    delta_e_mean: float = Field(ge=0, description="CIEDE2000 of the chart's patches, mean")
    delta_e_max: float = Field(ge=0, description="CIEDE2000 of the chart's patches, largest")
    chart: str = Field(description="Reference values that it was fitted to")

    @model_validator(mode="after")
    def _is_relative(self) -> "ColourCalibration":
        """Refuses values of white that are not positive, or not relative to their mean."""
        red, green, blue = self.white
        if min(self.white) <= 0 or abs((red + 2 * green + blue) / 4 - 1) > WHITE_TOLERANCE:
            raise ValueError("white must be positive, and (R + 2 G + B)/4 of it 1")
        return self
