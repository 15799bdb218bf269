"""The calibration of camera, hand–eye, lamp and sensor."""

import hashlib
import json
import math
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator

from acquisition.models.base import Matrix4, Value, Vector3
from acquisition.models.colour import ColourCalibration, Mosaic


def is_camera_matrix(matrix: tuple[Vector3, Vector3, Vector3]) -> bool:
    """Whether a matrix is [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]] with positive focal lengths."""
    (f_x, skew, _), (left, f_y, _), last = matrix
    return min(f_x, f_y) > 0 and skew == 0 and left == 0 and last == (0.0, 0.0, 1.0)


class SensorModel(Value):
    """Noise model of the sensor (photon transfer). A value is black_level_dn + electrons / gain_e_per_dn, rounded and
    clipped at 2^bits − 1."""

    bits: int = Field(ge=8, le=16, description="Bits of a value")
    gain_e_per_dn: float = Field(gt=0, description="Electrons per step of the value")
    read_noise_e: float = Field(ge=0, description="1 σ of a dark value, electrons")
    full_well_e: float = Field(gt=0, description="Electrons at which a pixel is full")
    black_level_dn: float = Field(ge=0, description="Value without light")
    mosaic: Mosaic | None = Field(
        default=None, description="Channels of the upper left 2 × 2 sites, row by row; none: a monochrome sensor"
    )

    @model_validator(mode="after")
    def _has_a_range(self) -> "SensorModel":
        if self.full_scale_dn <= 0:
            raise ValueError(f"black_level_dn must be below {2**self.bits - 1}, the largest value of {self.bits} bits")
        return self

    @property
    def full_scale_dn(self) -> float:
        """Range from the black level to clipping, DN."""
        return float(2**self.bits - 1) - self.black_level_dn


class LampLobe(Value):
    """Deviation of a lamp's lobe from cos^`lobe_exponent`: a factor over the angle off the axis, and a tilt.

    The factor is the exponential of a cubic spline through the logarithms of `factors`. The spline is flat on the axis;
    beyond the last knot the factor is constant. The intensity in a unit direction with components x and y in the lamp's
    frame is also multiplied by 1 + tilt_x x + tilt_y y.
    """

    knots_rad: Annotated[tuple[float, ...], Field(strict=False, min_length=2, max_length=40)] = Field(
        description="Angles off the axis, ascending from 0"
    )
    factors: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(strict=False)] = Field(
        description="Intensity over that of cos^lobe_exponent at each; the first is 1"
    )
    tilt: Annotated[tuple[float, float], Field(strict=False)] = Field(
        default=(0.0, 0.0), description="Relative increase towards the lamp's x and y, per unit of the direction"
    )

    @model_validator(mode="after")
    def _is_a_spline(self) -> "LampLobe":
        """Refuses knots that define no spline, a factor on the axis other than 1, and a tilt of 1 or more."""
        knots = self.knots_rad
        if len(knots) != len(self.factors):
            raise ValueError(f"{len(knots)} knots and {len(self.factors)} factors: give one factor for each knot")
        if knots[0] != 0 or any(b <= a for a, b in pairwise(knots)) or knots[-1] > math.pi / 2:
            raise ValueError("knots must ascend from 0 to at most 90° off the axis")
        if abs(self.factors[0] - 1) > 1e-9 or math.hypot(*self.tilt) >= 1:
            raise ValueError("the factor on the axis must be 1, and the tilt less than 1")
        return self


_Row5 = Annotated[tuple[float, ...], Field(strict=False, min_length=5, max_length=5)]
Matrix5 = Annotated[tuple[_Row5, ...], Field(strict=False, min_length=5, max_length=5)]


class FlatField(Value):
    """Sensitivity of the camera over the image, e^(a u + b v + c u² + d u v + e v²): 1 in the image's centre.

    u and v are measured from the centre in half diagonals. The model describes the lens, which dims smoothly towards
    the corners (cos⁴, vignetting). Differences between single pixels come from the sensor.
    """

    terms: Annotated[tuple[float, float, float, float, float], Field(strict=False)] = Field(
        description="a, b, c, d, e of u, v, u², u v, v², each a fraction at a half diagonal from the centre"
    )
    covariance: Matrix5 = Field(description="Covariance of the terms; no unit")


_Row3 = Annotated[tuple[float, ...], Field(strict=False, min_length=3, max_length=3)]
_Row6 = Annotated[tuple[float, ...], Field(strict=False, min_length=6, max_length=6)]
Matrix3 = Annotated[tuple[_Row3, ...], Field(strict=False, min_length=3, max_length=3)]
Matrix6 = Annotated[tuple[_Row6, ...], Field(strict=False, min_length=6, max_length=6)]


class Calibration(Value):
    """Calibration of camera, hand–eye and lamp with uncertainties; `calibration.json`.

    `lamp_intensity` makes albedo absolute: it is the signal of a perfectly white diffuse surface that faces the lamp on
    its axis at `reference_m`, as a fraction of full scale (SensorModel.full_scale_dn) per second of exposure. Off its
    axis, the lamp's radiant intensity falls as cos^lobe_exponent, multiplied by `lobe` if there is one.
    """

    width: int = Field(gt=0, description="Pixels of an image's row")
    height: int = Field(gt=0, description="Pixels of an image's column")
    camera_matrix: tuple[Vector3, Vector3, Vector3] = Field(strict=False, description="OpenCV, pixels")
    distortion: Annotated[
        tuple[float, float, float, float, float], Field(strict=False, description="k1 k2 p1 p2 k3, OpenCV")
    ]
    base_from_camera: Matrix4 = Field(description="Pose of the camera (z forward) in the arm's base frame, m")
    joint_offsets_rad: Annotated[tuple[float, float, float, float, float, float], Field(strict=False)] | None = Field(
        default=None,
        description="True joint angles less those that the controller reports, rad; none: not known, taken as 0",
    )
    tool_from_lamp: Matrix4 = Field(description="Pose of the lamp (z along its axis) in the tool frame, m")
    lamp_intensity: float = Field(
        gt=0,
        description="Signal of a white diffuse surface that faces the lamp on its axis at `reference_m`, fraction of "
        "full scale per second",
    )
    reference_m: float = Field(gt=0, description="Distance that `lamp_intensity` is for, m")
    lobe_exponent: float = Field(ge=0, description="Exponent of the cosine by which the intensity falls off the axis")
    lobe: LampLobe | None = Field(default=None, description="Deviation of the lobe from that power of the cosine")
    flat_field: FlatField | None = Field(
        default=None, description="The camera's sensitivity over the image; none: taken as uniform"
    )
    sensor: SensorModel = Field(description="The camera's values and their noise")
    colour: ColourCalibration | None = Field(
        default=None, description="White balance and colour matrix under the lamp; none: colours are the camera's own"
    )
    intensity_sigma: float = Field(ge=0, description="1 σ of each image's lamp intensity, as a fraction")
    lamp_position_sigma_m: float = Field(
        ge=0, description="1 σ of the lamp's position, per axis, independent from image to image"
    )
    tool_from_lamp_covariance: Matrix3 | None = Field(
        default=None,
        description="Covariance of the position of `tool_from_lamp`, an error that all images share; m², tool frame",
    )
    base_from_camera_covariance: Matrix6 | None = Field(
        default=None,
        description="Covariance of a small motion of the camera, an error that all images share: translation, m, and "
        "rotation vector, rad, in the camera's frame",
    )
    made_at: str = Field(description="ISO 8601 with time zone")
    valid_days: float = Field(
        gt=0, le=36_500, description="Validity, days; no session starts with an older calibration"
    )

    @field_validator("made_at")
    @classmethod
    def _is_a_moment(cls, made_at: str) -> str:
        """Refuses a date without time and zone: its age would not be known."""
        try:
            zone = datetime.fromisoformat(made_at).tzinfo
        except ValueError:
            zone = None
        if zone is None:
            raise ValueError(f"{made_at!r} is not a date and time with a time zone, such as '2026-11-30T09:00:00Z'")
        return made_at

    @model_validator(mode="after")
    def _is_a_camera(self) -> "Calibration":
        """Refuses a matrix that is transposed, skewed, or without a focal length."""
        if not is_camera_matrix(self.camera_matrix):
            raise ValueError(
                "camera_matrix must be [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]], in pixels, with f_x and f_y above 0"
            )
        return self

    @model_validator(mode="after")
    def _poses_are_rigid(self) -> "Calibration":
        """Refuses matrices that scale, shear or mirror, and transposed ones, whose place is in the last row."""
        for name in ("base_from_camera", "tool_from_lamp"):
            matrix = np.array(getattr(self, name))
            rotation = matrix[:3, :3]
            if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
                raise ValueError(f"{name} is not a rigid transform: its first three columns must be a rotation")
            if np.linalg.det(rotation) < 0:
                raise ValueError(f"{name} mirrors: one of its axes has the wrong sign (x × y must be z)")
            if matrix[3].tolist() != [0, 0, 0, 1]:
                raise ValueError(f"the last row of {name} must be [0, 0, 0, 1]: the place is the last column")
        return self

    @model_validator(mode="after")
    def _covariances_are_such(self) -> "Calibration":
        """Refuses matrices that are not covariances."""
        for name in ("tool_from_lamp_covariance", "base_from_camera_covariance"):
            stated = getattr(self, name)
            if stated is None:
                continue
            matrix = np.array(stated)
            scale = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
            correlation = matrix / np.outer(scale, scale)
            if np.abs(correlation - correlation.T).max() > 1e-6 or np.linalg.eigvalsh(correlation)[0] < -1e-6:
                raise ValueError(f"{name} must be symmetric without a negative variance in any direction")
        return self

    @property
    def valid_until(self) -> datetime:
        """The moment, with time zone, after which no session starts with this calibration."""
        return datetime.fromisoformat(self.made_at) + timedelta(days=self.valid_days)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the stated values. Spaces in the file and optional fields without a value do not change it."""
        stated = self.model_dump(mode="json", exclude_none=True)
        return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()
