"""Reference values of 24-patch colour charts: the published values of the usual chart, or those of a file.

The layout is McCamy's (1976): six columns and four rows, dark skin upper left, six neutral patches from white to black
in the last row.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError

COLUMNS, ROWS = 6, 4
NEUTRALS = range(18, 24)

PUBLISHED = """
dark skin,37.54,14.37,14.92
light skin,64.66,19.27,17.50
blue sky,49.32,-3.82,-22.54
foliage,43.46,-12.74,22.72
blue flower,54.94,9.61,-24.79
bluish green,70.48,-32.26,-0.37
orange,62.73,35.83,56.50
purplish blue,39.43,10.75,-45.17
moderate red,50.57,48.64,16.67
purple,30.10,22.54,-20.87
yellow green,71.77,-24.13,58.19
orange yellow,71.51,18.24,67.37
blue,28.37,15.42,-49.80
green,54.38,-39.72,32.27
red,42.43,51.05,28.62
yellow,81.80,2.67,80.41
magenta,50.63,51.28,-14.12
cyan,49.57,-29.71,-28.32
white 9.5,95.19,-1.03,2.93
neutral 8,81.29,-0.57,0.44
neutral 6.5,66.89,-0.75,-0.06
neutral 5,50.76,-0.13,0.14
neutral 3.5,35.63,-0.46,-0.48
black 2,20.64,0.07,-0.46
"""
"""Name, L*, a*, b* under D50, observer 2°: the maker's values for charts made from November 2014 on."""


@dataclass(frozen=True)
class ChartReference:
    """Names and CIELAB under D50 (24, 3) of a chart's patches, row by row, and their source."""

    names: tuple[str, ...]
    lab: FloatArray
    source: str


def published() -> ChartReference:
    """Returns the maker's values for the usual chart."""
    return _parsed(PUBLISHED, "24 patches, the maker's values from November 2014")


def read(path: Path) -> ChartReference:
    """Reads the values of another chart: 24 lines `name,L,a,b`, row by row from dark skin. Raises RigError
    config.invalid naming the line."""
    try:
        content = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: the reference values cannot be read: {error}") from error
    try:
        return _parsed(content, path.name)
    except ValueError as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: {error}; give 24 lines name,L,a,b") from error


def _parsed(content: str, source: str) -> ChartReference:
    names: list[str] = []
    values: list[list[float]] = []
    for number, line in enumerate((one for one in csv.reader(content.splitlines()) if one), 1):
        try:
            name, lightness, a, b = (part.strip() for part in line)
            row = [float(lightness), float(a), float(b)]
        except ValueError as error:
            if number == 1:
                continue  # the names of the columns
            raise ValueError(f"line {number} is not name,L,a,b") from error
        names.append(name)
        values.append(row)
    lab = np.array(values)
    if len(names) != COLUMNS * ROWS:
        raise ValueError(f"it holds {len(names)} patches")
    if not np.isfinite(lab).all() or lab[:, 0].min() < 0 or lab[:, 0].max() > 100:
        raise ValueError("L must lie between 0 and 100")
    return ChartReference(tuple(names), lab, source)
