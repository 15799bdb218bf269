"""Scenes are the same for the same seed, report seeds are refused, and captures hold the stated errors and faults."""

from pathlib import Path

import numpy as np
import pytest

from acquisition.formats.folders import near_light_folder
from acquisition.models.result import SolveSettings
from acquisition.normals import ObjectPlace, solve_stack
from tests.unseen import faults, patterns, scenes
from tests.unseen.captures import capture, write_folder
from tests.unseen.scenes import Scene

SMALL = 40


@pytest.fixture(scope="module")
def blob() -> Scene:
    return scenes.scene("blob", 0, "lambert", SMALL)


@pytest.fixture(scope="module")
def rings(blob: Scene) -> np.ndarray:
    return patterns.fixed("two-rings", blob, 6, 0, 4)


def test_scene_of_a_report_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="--report"):
        scenes.scene("blob", scenes.REPORT_SEEDS_FROM)


@pytest.mark.long
def test_scene_is_the_same_for_the_same_seed(blob: Scene) -> None:
    again = scenes.scene.__wrapped__("blob", 0, "lambert", SMALL)
    assert again is not blob
    assert again.key == blob.key
    assert (again.focal_px, again.radius_m, again.sensor) == (blob.focal_px, blob.radius_m, blob.sensor)
    assert scenes.scene("blob", 1, "lambert", SMALL).key != blob.key


@pytest.mark.long
@pytest.mark.parametrize("family", ["turned", "knot", "sheet"])
def test_scene_of_a_family_fills_the_frame(family: str) -> None:
    one = scenes.scene(family, 0, pixels=SMALL)
    corners = one.mesh.triangles.reshape(-1, 3)
    reach = np.max(np.abs(corners[:, :2] / -corners[:, 2:])) * one.focal_px / (one.pixels / 2)
    assert scenes.FILL[0] - 0.01 <= reach <= scenes.FILL[1] + 0.01 or -one.center[2] == scenes.DISTANCE_M[0]
    assert scenes.DISTANCE_M[0] <= -one.center[2] <= scenes.DISTANCE_M[1]


def test_gradings_are_nested_and_the_truth_is_unit(blob: Scene) -> None:
    true = blob.truth
    assert true.one_surface.sum() < true.within_78_deg.sum() < true.object.sum()
    assert not np.any(true.one_surface & ~true.within_78_deg)
    assert not np.any(true.within_78_deg & ~true.object)
    np.testing.assert_allclose(np.linalg.norm(true.normals[true.object], axis=1), 1, atol=1e-6)


def test_capture_is_paired_between_patterns_and_has_two_reads(blob: Scene, rings: np.ndarray) -> None:
    complete, part = capture(blob, rings, 3), capture(blob, rings[:4], 3)
    np.testing.assert_array_equal(complete.dn[:4], part.dn)
    assert complete.stack.lights[:4] == part.stack.lights
    assert np.any(complete.dn != complete.again)
    bright = complete.dn > 2000
    noise = np.std(complete.dn[bright].astype(float) - complete.again[bright]) / np.sqrt(2)
    expected = np.sqrt(np.mean(complete.dn[bright]) / blob.sensor.gain_e_per_dn)
    assert noise == pytest.approx(expected, rel=0.1)
    assert np.any(capture(blob, rings, 4).dn != complete.dn)


def test_capture_without_errors_is_solved_close_to_the_truth(blob: Scene, rings: np.ndarray) -> None:
    captured = capture(blob, rings)
    solved = solve_stack(
        captured.stack, captured.calibration, SolveSettings(),
        ObjectPlace(captured.rough_depth_m, silhouette=blob.truth.object),
    )  # fmt: skip
    assert np.median(blob.truth.error_deg(solved.normals)[blob.truth.one_surface]) < 3.0


def test_folder_of_a_capture_is_read_back(tmp_path: Path, blob: Scene, rings: np.ndarray) -> None:
    captured = capture(blob, rings)
    write_folder(tmp_path, blob, captured)
    images = near_light_folder.read(tmp_path / near_light_folder.LIGHTS, tmp_path)
    positions = [light.position for light in captured.stack.lights]
    np.testing.assert_allclose(images.lights.positions_m, positions, atol=1e-9)
    assert images.rough_depth_m == pytest.approx(blob.rough_depth_m)


@pytest.mark.parametrize("name", sorted(faults.ALL))
def test_every_fault_changes_the_capture(name: str, blob: Scene, rings: np.ndarray) -> None:
    sound, faulty = capture(blob, rings), capture(blob, rings, fault=faults.named(name))
    moved = [a.position != b.position for a, b in zip(sound.stack.lights, faulty.stack.lights, strict=True)]
    if name.startswith(("mirrored", "turned", "lamps")):
        assert all(moved)
        np.testing.assert_array_equal(sound.dn, faulty.dn)
    elif name == "swapped":
        assert sum(moved) == 2
        assert sorted(light.position for light in sound.stack.lights) == sorted(
            light.position for light in faulty.stack.lights
        )
    else:
        assert not any(moved)
        changed = [
            np.mean(a != b) > 0.02 for a, b in zip(sound.stack.whole.values, faulty.stack.whole.values, strict=True)
        ]
        expected = {"one": 1, "mov": len(rings) // 2}.get(name[:3], len(rings))
        assert sum(changed) == expected


def test_offset_and_ambient_light_have_their_level(blob: Scene, rings: np.ndarray) -> None:
    sound = capture(blob, rings)
    for name, expected in (("offset:0.1", 0.1), ("ambient:0.1", 0.1 * blob.ambient())):
        more = capture(blob, rings, fault=faults.named(name)).stack.whole.values - sound.stack.whole.values
        where = blob.truth.one_surface
        added = np.broadcast_to(expected, where.shape)[where]
        assert np.mean(more[:, where]) == pytest.approx(np.mean(added), rel=0.05)
    albedo = blob.truth.albedo[blob.truth.one_surface]
    assert np.mean(blob.ambient()[blob.truth.one_surface] / albedo) == pytest.approx(1, abs=0.35)


def test_fault_of_an_unknown_name_is_refused() -> None:
    with pytest.raises(ValueError, match="mirrored-y"):
        faults.named("sunlight")
