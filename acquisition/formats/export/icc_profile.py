"""ICC profile of sRGB: a matrix profile of version 4 with the standard's own curve (ICC.1:2022, IEC 61966-2-1).

Written out here because none of the libraries that are needed anyway brings one; with its primaries in the profile
connection space (D50) and its white it is what readers call sRGB.
"""

import struct
from functools import lru_cache

from acquisition import colour

D65_TO_D50 = (1.0478112, 0.0228866, -0.0501270, 0.0295424, 0.9904844, -0.0170491, -0.0092345, 0.0150436, 0.7521316)
"""Bradford's adaptation, row by row, as the tag `chad` states it."""

CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
"""g, a, b, c, d of Y = (a X + b)^g from d on, else c X."""


@lru_cache(1)
def srgb() -> bytes:
    """The profile's bytes."""
    colorants = {
        name: b"XYZ \0\0\0\0" + _fixed(*column)
        for name, column in zip((b"rXYZ", b"gXYZ", b"bXYZ"), colour.XYZ_D50_FROM_SRGB.T.tolist(), strict=True)
    }
    curve = b"para\0\0\0\0" + struct.pack(">HH", 3, 0) + _fixed(*CURVE)
    tags = {
        b"desc": _text("sRGB"),
        b"cprt": _text("No copyright, use freely"),
        b"wtpt": b"XYZ \0\0\0\0" + _fixed(*colour.D50_WHITE.tolist()),
        b"chad": b"sf32\0\0\0\0" + _fixed(*D65_TO_D50),
        **colorants,
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    }
    table, content, places = b"", b"", dict[bytes, int]()
    start = 128 + 4 + 12 * len(tags)
    for name, value in tags.items():
        if value not in places:  # equal tags share their bytes
            places[value] = start + len(content)
            content += value + bytes(-len(value) % 4)
        table += name + struct.pack(">II", places[value], len(value))
    body = struct.pack(">I", len(tags)) + table + content
    header = struct.pack(">I4sI4s4s4s", 128 + len(body), b"\0\0\0\0", 0x04400000, b"mntr", b"RGB ", b"XYZ ")
    header += struct.pack(">6H4s", 2026, 1, 1, 0, 0, 0, b"acsp") + bytes(28) + _fixed(*colour.D50_WHITE.tolist())
    return header + bytes(128 - len(header)) + body


def _fixed(*values: float) -> bytes:
    """s15Fixed16Number of each value."""
    return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))


def _text(text: str) -> bytes:
    """A multiLocalizedUnicodeType with one record, English."""
    encoded = text.encode("utf-16-be")
    return b"mluc\0\0\0\0" + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(encoded), 28) + encoded
