"""What the cell is known to be and what it has seen: calibration, images, normals.

Apart from `acquisition.types`, which says what is asked of a session and where lights are, because planning and solving
read these values while route and arm never do. The same conventions hold.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field

from acquisition.types import BoolArray, Float32Array, FloatArray, Joints, Light, Matrix4, Value, Vector3


class SensorModel(Value):
    """The camera's noise model: a value is black_level + electrons / gain_e_per_dn, rounded, clipped at 2^bits − 1."""

    bits: int = Field(ge=8, le=16)
    gain_e_per_dn: float = Field(gt=0)
    read_noise_e: float = Field(ge=0)
    full_well_e: float = Field(gt=0)
    black_level_dn: float = Field(ge=0)

    @property
    def full_scale_dn(self) -> float:
        """Values from black to clipping."""
        return float(2**self.bits - 1) - self.black_level_dn


class Calibration(Value):
    """What is known of camera, hand–eye and lamp, with its own uncertainty; `calibration.json`.

    `lamp_intensity` is the signal, as a fraction of full scale (SensorModel.full_scale_dn) per second of exposure, of a
    perfectly white matt surface that faces the lamp at `reference_m` on the lamp's axis: albedo is absolute. The lamp's
    radiant intensity falls off axis as cos^lobe_exponent.
    """

    width: int
    height: int
    camera_matrix: tuple[Vector3, Vector3, Vector3] = Field(strict=False)
    distortion: Annotated[tuple[float, float, float, float, float], Field(strict=False)]  # k1 k2 p1 p2 k3, OpenCV
    base_from_camera: Matrix4
    tool_from_lamp: Matrix4
    lamp_intensity: float = Field(gt=0)
    reference_m: float = Field(gt=0)
    lobe_exponent: float = Field(ge=0)
    sensor: SensorModel
    intensity_sigma: float = Field(ge=0, description="1 σ of each image's intensity, fraction")
    lamp_position_sigma_m: float = Field(ge=0, description="1 σ of the lamp's position, per axis")
    made_at: str
    valid_days: float = Field(gt=0)


# --------------------------------------------------------------------------------------------------------------- images


class ShotKey(Value):
    """Which image of a session: pass and number within the pass."""

    pass_number: int = Field(ge=0)
    number: int = Field(ge=0)


class FrameRef(Value):
    """A frame's file, relative to the session folder; linear 16-bit, row 0 at the top."""

    path: str
    width: int
    height: int
    sha256: str


class FrameQuality(Value):
    """What the check of a frame found, as shares of the object's pixels (or of the frame where no mask is known)."""

    saturated: float
    bright_level: float = Field(description="99.5th percentile above black, fraction of full scale")
    sharpness: float | None = Field(
        default=None, description="Share of the finest detail in all detail; blur takes it away; none: not measured"
    )
    shift_px: float | None = Field(
        default=None, description="How far the object seems to have moved since it was first seen; none: not measured"
    )
    accepted: bool
    reason: str = ""


class Shot(Value):
    """One image and what was measured while it was exposed."""

    key: ShotKey
    kind: Literal["light", "dark", "reference"]
    frame: FrameRef
    exposure_s: float
    light_number: int | None = None
    repeats: ShotKey | None = Field(default=None, description="The image that this one was taken again of")
    light: Light | None = Field(
        default=None, description="From the measured tool pose, never from where the arm was sent"
    )
    joints: Joints | None = None
    base_from_tool: Matrix4 | None = None
    lamp_on: bool = False
    attempt: int = 0
    arm_time_s: float | None = None
    taken_at: float = Field(description="Seconds since 1970, UTC")
    quality: FrameQuality


class FrameSource(Protocol):
    """Reads rows of stored frames, so that a stack need not fit into memory; picklable."""

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Rows [start, stop) of a frame, (rows, W) uint16 linear."""
        ...


@dataclass(frozen=True)
class Observations:
    """All images taken so far: lit shots, the lamp-off frame for each exposure time, and where to read them; `repeats`
    are lit shots and lamp-off frames that were taken twice, which tell of noise only."""

    shots: Sequence[Shot]
    darks: dict[float, Shot]
    frames: FrameSource
    repeats: Sequence[Shot] = ()

    @classmethod
    def of(cls, taken: Iterable[Shot], frames: FrameSource) -> "Observations":
        """What passes took, in the order of its keys; the lamp-off frame of an exposure time is the newest one."""
        shots = sorted(taken, key=lambda shot: (shot.key.pass_number, shot.key.number))
        darks = {shot.exposure_s: shot for shot in shots if shot.kind == "dark"}
        again = [shot for shot in shots if shot.kind == "reference"]
        older = [shot for shot in shots if shot.kind == "dark" and shot is not darks[shot.exposure_s]]
        return cls([shot for shot in shots if shot.kind == "light"], darks, frames, [*again, *older])


# -------------------------------------------------------------------------------------------------------------- results

LIT, ATTACHED, CAST, SATURATED, HIGHLIGHT = 1, 2, 4, 8, 16
"""Bits of NormalMap.flags, per light and pixel."""


@dataclass(frozen=True)
class Information:
    """What the images say of K sample pixels, the only part of a normal map that the planner's criterion reads.

    `matrices` is the Fisher information of (g, z), g = albedo × normal (3) in units of absolute albedo and z the depth
    in m, from the images alone (no prior), with the weights that the solver used.
    """

    rows: npt.NDArray[np.int64]  # (K,)
    columns: npt.NDArray[np.int64]  # (K,)
    matrices: FloatArray  # (K, 4, 4)


@dataclass(frozen=True)
class NormalMap:
    """What the solver found for each pixel; arrays are zero (σ: NaN) outside `mask`.

    `sigma_deg`: √ of the variance summed over both tangential directions, so that the angular error is Rayleigh with
    mean 0.886 σ, median 0.833 σ, P(e < σ) = 0.632. Where `doubtful` is true σ means nothing: fewer than three lights,
    or a larger share of `indirect` light (thrown by other surfaces) than its prediction can be trusted with.
    """

    normals: Float32Array  # (H, W, 3) view frame
    albedo: Float32Array  # (H, W) absolute
    depth: Float32Array  # (H, W) m along OpenCV's z
    sigma_deg: Float32Array  # (H, W)
    residual: Float32Array  # (H, W) rms of whitened residuals
    mask: BoolArray  # (H, W) pixels with a normal
    silhouette: BoolArray  # (H, W) pixels of the object, solved or not
    flags: npt.NDArray[np.uint8]  # (F, H, W)
    intensity_factors: FloatArray  # (F,)
    information: Information
    indirect: Float32Array | None = None  # (H, W) share of all light that other surfaces threw; none: not predicted
    doubtful: BoolArray | None = None  # (H, W)
    albedo_rgb: Float32Array | None = None  # (H, W, 3) of each channel; none: grey images
    noise: dict[str, float] = field(default_factory=dict[str, float])  # names of parameters → values used
    notes: dict[str, Any] = field(default_factory=dict[str, Any])


class ResultSummary(Value):
    """The figures of one result that a person reads first."""

    images: int
    object_pixels: int
    solved_pixels: int
    mean_sigma_deg: float = Field(
        description="Over the solved pixels inside the silhouette that are seen no more than 78° from their normal"
    )
    median_sigma_deg: float
    region_sigma_deg: float | None = Field(
        default=None, description="The mean over those in the region of interest; none: no region is drawn"
    )
    predicted_sigma_deg: float | None
    predicted_median_deg: float | None
    fewer_than_three_lights: float
    intensity_factors: list[float]
    noise: dict[str, float]


class SolveSettings(Value):
    """How normals are solved."""

    depth_rounds: int = Field(
        default=2, ge=0, le=10, description="Times that depth is integrated and the solve repeated"
    )
    shadow_threshold: float = Field(default=0.08, ge=0, lt=0.5, description="Of the pixel's largest normalised value")
    robust: bool = True
    keep_steps: bool = Field(
        default=False,
        description="Let depth jump where normals disagree with their neighbours; elsewhere it is a little less exact",
    )
