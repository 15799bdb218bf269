"""Markers of ChArUco boards: each white square has another one, so that their dictionary limits a board's size."""

MAX_MARKERS = 250
"""Number of different markers of the dictionary (`acquisition.calibrate.charuco.DICTIONARY`)."""


def refuse_too_many_squares(columns: int, rows: int) -> None:
    """Raises ValueError for a ChArUco board of more white squares than there are markers."""
    if columns * rows // 2 > MAX_MARKERS:
        squares = f"{columns} × {rows} squares need {columns * rows // 2} markers"
        raise ValueError(f"{squares}, but there are {MAX_MARKERS}: use fewer, larger squares")
