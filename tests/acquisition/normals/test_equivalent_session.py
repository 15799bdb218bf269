"""Folders' captures in a session's terms, and subsets of image sets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquisition import geometry
from acquisition.formats import folders
from acquisition.models.errors import RigError
from acquisition.models.result import SolveSettings
from acquisition.normals import distant, equivalent_session, near_light
from acquisition.normals.equivalent_session import EquivalentSession
from acquisition.normals.images.image_set import DistantLights, ImageSet, NearLights
from acquisition.plan import sample_pixels, visibility
from tests.acquisition.formats.folders import small


@pytest.fixture(scope="module")
def diligent(tmp_path_factory: pytest.TempPathFactory) -> ImageSet:
    folder = tmp_path_factory.mktemp("diligent")
    return folders.read(small.diligent(folder / "in"), folder)


def test_only_keeps_images_with_their_lights(diligent: ImageSet, tmp_path: Path) -> None:
    near = folders.read(small.near(tmp_path / "near"), tmp_path)
    for images in (diligent, near):
        some = images.only([4, 1])
        assert some.names == (images.names[4], images.names[1])
        for place, number in enumerate((4, 1)):
            np.testing.assert_array_equal(some.values(place, 3, 20), images.values(number, 3, 20))
        if isinstance(images.lights, NearLights):
            assert isinstance(some.lights, NearLights)
            np.testing.assert_array_equal(some.lights.positions_m, images.lights.positions_m[[4, 1]])
            np.testing.assert_array_equal(some.lights.intensity, images.lights.intensity[[4, 1]])
        else:
            assert isinstance(some.lights, DistantLights)
            np.testing.assert_array_equal(some.lights.directions, images.lights.directions[[4, 1]])
            np.testing.assert_array_equal(some.lights.intensities, images.lights.intensities[[4, 1]])


def of_distant(images: ImageSet) -> EquivalentSession:
    far = distant.from_afar(images)
    return equivalent_session.of_near(far, near_light.solve(far, SolveSettings()))


def test_of_distant_lights_shine_from_their_directions(diligent: ImageSet) -> None:
    session = of_distant(diligent)
    assert isinstance(diligent.lights, DistantLights)
    units = diligent.lights.directions / np.linalg.norm(diligent.lights.directions, axis=1, keepdims=True)
    for shot, unit in zip(session.observations.shots, units, strict=True):
        assert shot.light is not None
        toward = np.array(shot.light.position) - session.center
        assert np.linalg.norm(np.cross(toward, unit)) < np.radians(0.01) * (toward @ unit)
        np.testing.assert_allclose(-np.array(shot.light.axis), unit, atol=1e-4)


def test_of_distant_ball_keeps_shape_and_shadows(diligent: ImageSet) -> None:
    """The points are a ball of the stated size, convex: its shadows are attached ones, none cast."""
    session = of_distant(diligent)
    usable = sample_pixels.usable(session.normal_map, session.calibration)
    assert len(usable) > 0.7 * np.count_nonzero(session.normal_map.mask)
    sample = sample_pixels.samples(session.normal_map, session.calibration, usable)
    radius_m = distant.OBJECT_SIZE_M / 2
    top = sample.point[2].max()
    np.testing.assert_allclose(sample.point[:2], radius_m * sample.normal[:2], atol=0.1 * radius_m)
    np.testing.assert_allclose(sample.point[2] - top, radius_m * (sample.normal[2] - 1), atol=0.15 * radius_m)
    light = [shot.light for shot in session.observations.shots if shot.light is not None][4]
    shaded = visibility.shaded(session.normal_map, [light], session.calibration, (sample.row, sample.column))[0]
    facing = -np.array(light.axis) @ sample.normal
    assert np.mean(shaded[facing > 0.15]) < 0.02


def test_of_distant_information_grows_with_images(diligent: ImageSet) -> None:
    few, many = (of_distant(images) for images in (diligent.only([1, 2, 3, 4]), diligent))
    before, after = (
        np.median(np.trace(one.normal_map.information.matrices[:, :3, :3], axis1=1, axis2=2)) for one in (few, many)
    )
    assert after > 1.2 * before


def test_of_near_shots_stand_where_the_lamps_stand(tmp_path: Path) -> None:
    images = folders.read(small.near(tmp_path / "near"), tmp_path)
    session = equivalent_session.of_near(images, near_light.solve(images, SolveSettings()))
    assert isinstance(images.lights, NearLights)
    np.testing.assert_array_equal(
        [shot.light.position for shot in session.observations.shots if shot.light is not None],
        images.lights.positions_m,
    )
    assert [shot.exposure_s for shot in session.observations.shots] == images.lights.intensity.tolist()
    assert session.center == pytest.approx([0, 0, -0.47], abs=0.015)
    assert np.linalg.norm(geometry.VIEW_FROM_CAMERA[:3, :3] @ session.center - [0, 0, 0.47]) < 0.02


def test_equivalent_session_of_the_other_kind_is_refused(diligent: ImageSet, tmp_path: Path) -> None:
    near = folders.read(small.near(tmp_path / "near"), tmp_path)
    session = of_distant(diligent)
    with pytest.raises(RigError, match="positions"):
        equivalent_session.of_near(diligent, session.normal_map)
    with pytest.raises(RigError, match="near"):
        distant.from_afar(near)
    nothing = replace(session.normal_map, mask=np.zeros_like(session.normal_map.mask))
    far = distant.from_afar(diligent)
    with pytest.raises(RigError, match="no pixel"):
        equivalent_session.of_near(far, nothing)
