"""`lightpose solve` as a process: seconds from start to written maps, and peak memory.

Each run is a process of its own, since what was imported or held before would flatter it.
"""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from pytest_benchmark.fixture import BenchmarkFixture

MEASURED = """\
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
"""Runs a command and prints its peak of memory in kilobytes. A child's account begins with the size of its parent, so
the parent has to be a small one."""


def lights(count: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    slant = np.radians(np.where(np.arange(count) % 2, 25, 45))
    return np.stack([np.sin(slant) * np.cos(angle), np.sin(slant) * np.sin(angle), np.cos(slant)], axis=-1)


def folder(path: Path, size: tuple[int, int], count: int, *, colour: bool, suffix: str) -> Path:
    """A DiLiGenT-style folder of noisy sixteen-bit images of a wavy surface."""
    path.mkdir()
    rng = np.random.default_rng(0)
    v, u = np.mgrid[: size[0], : size[1]].astype(np.float32) / 120
    normals = np.stack([np.sin(u) * 0.5, np.cos(v) * 0.5, np.ones_like(u)])
    normals /= np.linalg.norm(normals, axis=0)
    names = [f"{number:03d}{suffix}" for number in range(count)]
    for name, light in zip(names, lights(count), strict=True):
        shade = np.clip(np.tensordot(light.astype(np.float32), normals, 1), 0, 1) * 40_000
        image = shade[..., None] * np.array([1.0, 0.8, 0.6], np.float32) if colour else shade
        stored = (image + rng.integers(0, 200, image.shape)).astype(np.uint16)
        if suffix == ".tiff":
            tifffile.imwrite(path / name, stored)
        else:
            cv2.imwrite(str(path / name), stored)
    (path / "filenames.txt").write_text("\n".join(names))
    np.savetxt(path / "light_directions.txt", lights(count))
    np.savetxt(path / "light_intensities.txt", np.ones((count, 3)))
    cv2.imwrite(str(path / "mask.png"), np.full(size, 255, np.uint8))
    return path


def near_folder(path: Path, size: tuple[int, int], count: int) -> Path:
    """A near-light folder of sixteen-bit images of a wavy surface half a metre away, which fills them."""
    path.mkdir()
    rng = np.random.default_rng(0)
    focal, depth = 4.0 * size[1], 0.5
    v, u = np.mgrid[: size[0], : size[1]].astype(np.float32)
    x, y = (u - size[1] / 2) / focal * depth, -(v - size[0] / 2) / focal * depth
    slope = np.stack([0.4 * np.sin(x / 0.004), 0.4 * np.cos(y / 0.004), np.ones_like(x)])
    slope /= np.linalg.norm(slope, axis=0)
    described: list[dict[str, object]] = []
    for number, light in enumerate(lights(count).astype(np.float32)):
        place = 0.4 * light - np.array([0, 0, depth], np.float32)
        to_lamp = [place[0] - x, place[1] - y, np.float32(place[2] + depth)]
        squared = to_lamp[0] ** 2 + to_lamp[1] ** 2 + to_lamp[2] ** 2
        shade = sum(part * one for part, one in zip(slope, to_lamp, strict=True)) * (0.3 * 0.4**2) / squared**1.5
        stored = np.clip(shade, 0, 1) * 65_535 + rng.integers(0, 100, size)
        tifffile.imwrite(path / f"{number:03d}.tiff", stored.astype(np.uint16))
        position = (1000 * place * [1, -1, -1]).tolist()
        described.append({"file": f"{number:03d}.tiff", "position": position, "intensity": 1.0})
    camera = {"K": [[focal, 0, size[1] / 2], [0, focal, size[0] / 2], [0, 0, 1]]}
    content = {"unit": "mm", "reference_mm": 400, "camera": camera, "lights": described, "depth_mm": 1000 * depth}
    (path / "lights.json").write_text(json.dumps(content))
    mask = np.full(size, 255, np.uint8)
    mask[:, 0] = 0  # a mask that leaves something out is the object's silhouette
    cv2.imwrite(str(path / "mask.png"), mask)
    return path


def solve(images: Path, out: Path, solver: str) -> float:
    """Solves and writes in a process of its own; its peak of memory in GB. The summary names what `auto` takes."""
    command = [sys.executable, "-m", "api.cli", "solve", str(images), "--out", str(out), "--json"]
    command += [] if solver == "near" else ["--solver", solver]
    ended = subprocess.run([sys.executable, "-c", MEASURED, *command], check=True, capture_output=True, text=True)
    *_, summary, kilobytes = ended.stdout.splitlines()
    assert json.loads(summary)["solver"] == ("distant" if solver == "auto" else solver)
    return float(kilobytes) / 1e6


@pytest.mark.parametrize("colour", [False, True], ids=["grey", "colour"])
def test_solve_command_megapixel_twenty_lights_time_and_memory(
    benchmark: BenchmarkFixture, tmp_path: Path, colour: bool
) -> None:
    """Starts, reads PNG files, solves and writes all maps and the report: 8.7 and 11.5 s (November 2026)."""
    images = folder(tmp_path / "images", (1000, 1000), 20, colour=colour, suffix=".png")
    solve(images, tmp_path / "before", "auto")
    outs = (tmp_path / str(number) for number in range(3))
    peak = benchmark.pedantic(lambda: solve(images, next(outs), "auto"), rounds=3)
    benchmark.extra_info["peak memory in GB"] = round(peak, 2)


@pytest.mark.parametrize("solver", ["ls", "auto"])
def test_solve_command_twelve_megapixels_memory(benchmark: BenchmarkFixture, tmp_path: Path, solver: str) -> None:
    """With depth, all maps and the report: 1.36 and 1.56 GB, of which 0.19 GB are the stack (November 2026)."""
    images = folder(tmp_path / "images", (3000, 4000), 8, colour=False, suffix=".tiff")
    peak = benchmark.pedantic(solve, args=(images, tmp_path / "out", solver), rounds=1)
    benchmark.extra_info["peak memory in GB"] = round(peak, 2)


@pytest.mark.parametrize("count", [8, 32])
def test_solve_command_near_light_twelve_megapixels_time_and_memory(
    benchmark: BenchmarkFixture, tmp_path: Path, count: int
) -> None:
    """The whole near-light recipe, at most 45 s under 8 lights. Under 32 the stack takes 1.5 GB as floats: memory grows
    with the pixels, not with the images, but for the flags, which lie in a file."""
    images = near_folder(tmp_path / "images", (3000, 4000), count)
    peak = benchmark.pedantic(solve, args=(images, tmp_path / "out", "near"), rounds=1)
    benchmark.extra_info["peak memory in GB"] = round(peak, 2)
