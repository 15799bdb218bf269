"""The report of a calibration: what to do, values with 1 σ, correlations, residuals, pictures, origins."""

from pathlib import Path

import numpy as np

from acquisition.formats.report import calibration_page
from acquisition.models.calibration_result import CameraResult, HighlightResidual, LampResult, ViewResidual

VIEWS = [
    ViewResidual(image=f"{number}.tiff", sha256="0" * 64, corners=48, left_out=0, rms_px=rms)
    for number, rms in enumerate((0.05, 0.06, 0.05, 0.31))
]
NOT_SEEN = ViewResidual(image="4.tiff", sha256="0" * 64, corners=0, left_out=0, rms_px=None)


def camera() -> CameraResult:
    covariance = np.diag([4.0, 4.0, 1.0, 1.0, 1e-4, 1e-4, 1e-8, 1e-8, 1e-4])
    covariance[0, 1] = covariance[1, 0] = 3.6
    return CameraResult.model_validate(
        {
            "made_at": "2026-11-23T08:00:00Z", "version": "1", "width": 640, "height": 480,
            "camera_matrix": [[800.1234, 0.0, 320.0], [0.0, 801.0, 240.0], [0.0, 0.0, 1.0]],
            "distortion": [0.0] * 5, "covariance": covariance.tolist(), "warp_m": [1e-4, 0.0],
            "corner_sigma_px": 0.05, "projection_sigma_px": 0.1, "worst_projection_sigma_px": 0.3,
            "views": [*VIEWS, NOT_SEEN],
        }
    )  # fmt: skip


def page(folder: Path) -> str:
    calibration_page.write(folder, "Calibration <1>", {"camera": "pylon 22", "arm": "UR5 7"}, ["Use it & be glad."])
    return (folder / "report.html").read_text(encoding="utf-8")


def test_calibration_page_states_values_with_sigma_and_residuals(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(camera().model_dump_json())
    (tmp_path / "residuals.png").write_bytes(b"PNG")
    made = page(tmp_path)
    assert "Calibration &lt;1&gt;" in made
    assert "Use it &amp; be glad." in made
    assert "<th>f_x<td>800.1<td>± 2" in made
    assert ">+0.90" in made  # f_x and f_y
    assert "<tr class=far><th>3.tiff" in made
    assert "the board is not seen" in made
    assert "data:image/png;base64,UE5H" in made
    assert "pylon 22" in made
    assert "Lamp" not in made


def test_calibration_page_of_lamp_names_images_not_used(tmp_path: Path) -> None:
    images = [
        HighlightResidual(image="0.tiff", sha256="0" * 64, residual_px=0.1),
        HighlightResidual(image="1.tiff", sha256="0" * 64, residual_px=None, why_not="the highlight is clipped"),
    ]
    found = LampResult(
        made_at="2026-11-23T08:00:00Z", version="1", tool_from_lamp_m=(0.01, 0.0, 0.0521),
        covariance=((1e-8, 0.0, 0.0), (0.0, 1e-8, 0.0), (0.0, 0.0, 4e-8)), position_sigma_m=1.4e-4,
        sphere_center_m=(0.5, 0.0, 0.02), sphere_radius_m=0.025, highlight_sigma_px=0.1, images=tuple(images),
    )  # fmt: skip
    (tmp_path / "lamp.json").write_text(found.model_dump_json())
    made = page(tmp_path)
    assert "lamp z in the tool&#x27;s frame<td>52.10<td>± 0.2<td>mm" in made
    assert "the highlight is clipped" in made
