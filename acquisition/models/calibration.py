"""The calibration of camera, hand–eye, lamp and sensor."""

import hashlib
import json
from typing import Annotated

from pydantic import Field

from acquisition.models.base import Matrix4, Value, Vector3


class SensorModel(Value):
    """Sensor noise model (photon transfer): a value is black_level + electrons / gain_e_per_dn, rounded, clipped at
    2^bits − 1."""

    bits: int = Field(ge=8, le=16, description="Bits of a value")
    gain_e_per_dn: float = Field(gt=0, description="Electrons per step of the value")
    read_noise_e: float = Field(ge=0, description="1 σ of a dark value, electrons")
    full_well_e: float = Field(gt=0, description="Electrons at which a pixel is full")
    black_level_dn: float = Field(ge=0, description="Value without light")

    @property
    def full_scale_dn(self) -> float:
        """Range from the black level to clipping, DN."""
        return float(2**self.bits - 1) - self.black_level_dn


class Calibration(Value):
    """Calibration of camera, hand–eye and lamp with uncertainties; `calibration.json`.

    `lamp_intensity` is the signal, as a fraction of full scale (SensorModel.full_scale_dn) per second of exposure, of a
    perfectly white diffuse surface that faces the lamp at `reference_m` on its axis: albedo is absolute. The lamp's
    radiant intensity falls off its axis as cos^lobe_exponent.
    """

    width: int = Field(description="Pixels of an image's row")
    height: int = Field(description="Pixels of an image's column")
    camera_matrix: tuple[Vector3, Vector3, Vector3] = Field(strict=False, description="OpenCV, pixels")
    distortion: Annotated[
        tuple[float, float, float, float, float], Field(strict=False, description="k1 k2 p1 p2 k3, OpenCV")
    ]
    base_from_camera: Matrix4 = Field(description="Pose of the camera (z forward) in the arm's base frame, m")
    tool_from_lamp: Matrix4 = Field(description="Pose of the lamp (z along its axis) in the tool frame, m")
    lamp_intensity: float = Field(gt=0, description="Fraction of full scale per second, as above")
    reference_m: float = Field(gt=0, description="Distance that `lamp_intensity` is for, m")
    lobe_exponent: float = Field(ge=0, description="Exponent of the cosine by which the lamp falls off its axis")
    sensor: SensorModel = Field(description="The camera's values and their noise")
    intensity_sigma: float = Field(ge=0, description="1 σ of each image's lamp intensity, as a fraction")
    lamp_position_sigma_m: float = Field(ge=0, description="1 σ of the lamp's position, per axis")
    made_at: str = Field(description="ISO 8601 with time zone")
    valid_days: float = Field(gt=0, description="Days after which no session starts with it")

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the values, so that spaces in the file do not matter."""
        return hashlib.sha256(json.dumps(self.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()
