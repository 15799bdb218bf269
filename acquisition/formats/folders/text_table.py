"""Parsing of text tables with one row for each image. Errors name the line."""

import math
import unicodedata
from pathlib import Path

import numpy as np

from acquisition.formats.folders.refusal import refusal, text
from acquisition.models.base import FloatArray


def lines(path: Path) -> list[tuple[int, str]]:
    """Returns the lines that are not blank, stripped, each with its number in the file from 1. Raises RigError
    folder.invalid."""
    numbered = enumerate(text(path).splitlines(), start=1)
    return [(number, line.strip()) for number, line in numbered if line.strip()]


def numbers(path: Path, line: int, words: list[str]) -> list[float]:
    """Parses the finite numbers of one line. Raises RigError folder.invalid naming the line."""
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise refusal(path, f"line {line}: {error}: write numbers") from error
    if not all(math.isfinite(value) for value in values):
        raise refusal(path, f"line {line}: {' '.join(words)} is not finite: correct it, or remove the image")
    return values


def rows(path: Path, columns: tuple[int, ...], count: int, listing: str) -> FloatArray:
    """Reads a table of `count` rows with one of the allowed numbers of `columns`; `listing` names the list of images.

    Raises RigError folder.invalid naming what is wrong.
    """
    table_lines = lines(path)
    table = [numbers(path, number, line.replace(",", " ").split()) for number, line in table_lines]
    for (number, _), row in zip(table_lines, table, strict=True):
        if len(row) not in columns or len(row) != len(table[0]):
            wanted = " or ".join(str(one) for one in columns)
            raise refusal(path, f"line {number} has {len(row)} numbers: each line needs {wanted}, all lines the same")
    if len(table) != count:
        raise refusal(path, f"has {len(table)} rows, but {listing} names {count} images: give one row for each image")
    return np.array(table, dtype=np.float64)


def listed_file(folder: Path, name: str) -> Path:
    """Returns the file that a list in `folder` names. Lists of another machine may name the folders of that machine,
    and macOS composes accented letters of file names otherwise than most programs do."""
    alone = name.replace("\\", "/").rsplit("/", maxsplit=1)[-1]
    spelled = (unicodedata.normalize(form, one) for one in (name, alone) for form in ("NFC", "NFD"))
    for one in (name, alone, *spelled):
        if (folder / one).is_file():
            return folder / one
    return folder / alone
