"""Images of a 24-patch colour chart in its printed frame, lit by the near lamp, as a mosaic sensor sees them.

The patches are spectra (`spectra.chart_response`), so no matrix maps the camera's values to the reference exactly, as
on a bench. The frame's four markers stand one patch's distance outside of the corners.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import SensorModel
from hardware_sim import sensor, spectra
from hardware_sim.render import Lamp, Lens

PITCH_M = 0.012
"""Distance of the patches' centres: a chart of 72 × 48 mm."""

PATCH_SHARE, MARKER_SHARE = 0.85, 0.7
"""Sides of a patch and of a marker, as shares of that distance."""

GAP_ALBEDO, PAPER_ALBEDO, INK_ALBEDO = 0.04, 0.85, 0.05
BORDER_PATCHES = 1.75
"""Width of the paper round the patches' centres, in patches."""

MARKERS = ((-1.0, -1.0), (6.0, -1.0), (6.0, 4.0), (-1.0, 4.0))
DICTIONARY, MARKER_BITS = cv2.aruco.DICT_4X4_50, 6
SUBDIVISION = 2


@dataclass(frozen=True)
class ColourChart:
    """A chart at a pose (4, 4) in the object's frame: x along columns, y along rows, z into the chart, origin at the
    centre of the first patch."""

    object_from_chart: FloatArray

    def signal(self, lens: Lens, lamp: Lamp, cell: npt.NDArray[np.uint8]) -> FloatArray:
        """Image (H, W); 1 is the mean of white under the lamp at its reference. `cell` (2, 2) holds the channels."""
        total = np.zeros(lens.height * lens.width)
        rows, columns = np.divmod(np.arange(total.size, dtype=float), lens.width)
        channel = cell[rows.astype(int) % 2, columns.astype(int) % 2]
        chart_from_object = geometry.inverse(self.object_from_chart)
        offsets = (np.arange(SUBDIVISION) + 0.5) / SUBDIVISION - 0.5
        eye = geometry.transform(chart_from_object, lens.eye[None])[0]
        for down in offsets:
            for right in offsets:
                away = geometry.rotate(chart_from_object, lens.directions(columns + right, rows + down).astype(float))
                points = eye - away * (eye[2] / away[:, 2])[:, None]
                seen = self._reflected(points[:, :2] / PITCH_M)[np.arange(total.size), channel]
                in_object = geometry.transform(self.object_from_chart, points)
                normal = np.broadcast_to(-self.object_from_chart[:3, 2], in_object.shape)
                total += seen * lamp.irradiance(in_object, normal)
        return total.reshape(lens.height, lens.width) / SUBDIVISION**2

    def frame(
        self, lens: Lens, lamp: Lamp, model: SensorModel, cell: npt.NDArray[np.uint8], exposure: float,
        random: np.random.Generator,
    ) -> npt.NDArray[np.uint16]:  # fmt: skip
        """The camera's frame (H, W): `exposure` is the fraction of full scale that a signal of 1 gives."""
        return sensor.expose((exposure * self.signal(lens, lamp, cell)).astype(np.float32), model, random)

    def _reflected(self, place: FloatArray) -> FloatArray:
        """Values (N, 3) of R, G, B at places (N, 2) in patches."""
        out = np.broadcast_to(0.05 * spectra.white(), (len(place), 3)).copy()  # the table
        x, y = place.T
        border = BORDER_PATCHES
        out[(x > -border) & (x < 5 + border) & (y > -border) & (y < 3 + border)] = PAPER_ALBEDO * spectra.white()
        column, row = np.rint(x).astype(int), np.rint(y).astype(int)
        body = (x > -0.55) & (x < 5.55) & (y > -0.55) & (y < 3.55)
        out[body] = GAP_ALBEDO * spectra.white()
        patch = body & (np.abs(x - column) < PATCH_SHARE / 2) & (np.abs(y - row) < PATCH_SHARE / 2)
        out[patch] = spectra.chart_response()[6 * row[patch] + column[patch]]
        for number, (u, v) in enumerate(MARKERS):
            across, along = ((one + MARKER_SHARE / 2) / MARKER_SHARE for one in (x - u, y - v))
            inside = (across >= 0) & (across < 1) & (along >= 0) & (along < 1)
            bits = self._markers[number]
            black = bits[(along[inside] * MARKER_BITS).astype(int), (across[inside] * MARKER_BITS).astype(int)] == 0
            out[inside] = np.where(black, INK_ALBEDO, PAPER_ALBEDO)[:, None] * spectra.white()
        return out

    @cached_property
    def _markers(self) -> list[npt.NDArray[np.uint8]]:
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return [np.asarray(cv2.aruco.generateImageMarker(dictionary, n, MARKER_BITS), np.uint8) for n in range(4)]
