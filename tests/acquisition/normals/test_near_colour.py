"""Near-light folders of RGB images, from the files to normals and the channels' albedos."""

from pathlib import Path

import numpy as np
import tifffile

from acquisition.formats import folders
from acquisition.models.result import SolveSettings
from acquisition.normals import near_light
from acquisition.normals.images.colour_albedo import CAMERA
from tests.acquisition.formats.folders import small

CHANNELS = np.array([1.0, 0.5, 0.15])


def test_solve_near_rgb_uses_unclipped_channels_and_gives_each_albedo(tmp_path: Path) -> None:
    grey = small.near(tmp_path / "near")
    for path in sorted(grey.glob("*.tiff")):
        image = tifffile.imread(path)
        bright = image.astype(float)[..., None] * CHANNELS * (2.0 if path.stem == "0" else 1.0)
        tifffile.imwrite(path, np.clip(np.round(bright), 0, 65535).astype(np.uint16), photometric="rgb")
    # The first lamp is twice as bright, so that red clips there where the ball faces it.
    lights = (grey / "lights.json").read_text().replace('"intensity": 0.9}', '"intensity": 1.8}')
    (grey / "lights.json").write_text(lights)
    images = folders.read(grey, tmp_path)
    assert np.mean(np.asarray(images.rows(0, 0, images.height))[..., 0][images.mask] == 65535) > 0.05
    found = near_light.solve(images, SolveSettings())
    assert images.truth is not None
    inner = found.mask & (images.truth[..., 2] > 0.5)
    cosine = np.sum(found.normals * images.truth, axis=-1)[inner]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 1.0
    assert found.albedo_rgb is not None
    ratio = found.albedo_rgb[inner] / found.albedo_rgb[inner].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(np.median(ratio, axis=0), CHANNELS / CHANNELS.mean(), rtol=0.02)
    assert found.notes["colour"] == CAMERA
