"""An invalid folder is refused before solving, with the file's name and a remedy."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from scipy.io import savemat

from acquisition.formats import folders
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.formats.folders import small

Damage = Callable[[Path], object]


def cut(name: str, keep: float = 0.5) -> Damage:
    def damage(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: int(len(content) * keep)])

    return damage


def flip(name: str) -> Damage:
    def damage(folder: Path) -> None:
        content = bytearray((folder / name).read_bytes())
        content[len(content) // 2] ^= 0xFF
        (folder / name).write_bytes(bytes(content))

    return damage


def image(name: str, pixels: np.ndarray) -> Damage:
    return lambda folder: cv2.imwrite(str(folder / name), pixels)


def line(name: str, number: int, content: str | None) -> Damage:
    def damage(folder: Path) -> None:
        lines = (folder / name).read_text().splitlines()
        lines[number : number + 1] = [] if content is None else [content]
        (folder / name).write_text("\n".join(lines) + "\n")

    return damage


def first(count: int, *names: str) -> Damage:
    def damage(folder: Path) -> None:
        for name in names:
            (folder / name).write_text("\n".join((folder / name).read_text().splitlines()[:count]))

    return damage


def field(path: str, value: object) -> Damage:
    def damage(folder: Path) -> None:
        content = json.loads((folder / "lights.json").read_text())
        *parents, last = path.split(".")
        place = content
        for name in parents:
            place = place[int(name) if name.isdigit() else name]
        place[last] = value
        (folder / "lights.json").write_text(json.dumps(content))

    return damage


def scaled(factor: float) -> Damage:
    """Multiplies the positions of all lamps."""

    def damage(folder: Path) -> None:
        content = json.loads((folder / "lights.json").read_text())
        for light in content["lights"]:
            light["position"] = [factor * value for value in light["position"]]
        (folder / "lights.json").write_text(json.dumps(content))

    return damage


def exr(folder: Path) -> None:
    pixels = np.full((N, N, 3), 0.5, np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": pixels}).write(str(folder / "002.exr"))
    names = (folder / "filenames.txt").read_text()
    (folder / "filenames.txt").write_text(names.replace("002.png", "002.exr"))


def float_images(folder: Path, wrong: float) -> None:
    """Float images, large enough that not all of their rows are looked at, with one wrong value."""
    size = 150
    for number, path in enumerate(sorted(folder.glob("*.tiff"))):
        pixels = np.random.default_rng(number).uniform(0.2, 0.8, (size, size)).astype(np.float32)
        pixels[77, 40] = wrong if number == 2 else 0.5
        tifffile.imwrite(path, pixels)
    cv2.imwrite(str(folder / "mask.png"), np.full((size, size), 255, np.uint8))
    (folder / "normals_gt.npy").unlink()


def never_switched(folder: Path, noise: float) -> None:
    """Images of one light under different ones."""
    first = cv2.imread(str(folder / "img 0.png"), cv2.IMREAD_UNCHANGED)
    for number, path in enumerate(sorted(folder.glob("img *.png"))):
        spread = noise * 65535 * np.random.default_rng(number).standard_normal(first.shape)
        cv2.imwrite(str(path), np.clip(first + spread, 0, 65535).astype(np.uint16))


def every(folder: Path, pixels: np.ndarray) -> None:
    for path in folder.glob("0*.png"):
        cv2.imwrite(str(path), pixels)


N = small.SIZE
GREY = np.full((N, N), 20_000, np.uint16)
DITHER = np.random.default_rng(0).random((N, N, 3))
TABLES = ("filenames.txt", "light_directions.txt", "light_intensities.txt")
DILIGENT: dict[str, tuple[Damage, str, str]] = {
    "another size": (image("003.png", np.full((N, N + 1, 3), 9_000, np.uint16)), "003.png", "41 × 40"),
    "missing": (lambda folder: (folder / "004.png").unlink(), "004.png", "missing"),
    "truncated png": (cut("002.png"), "002.png", "truncated"),
    "png without its end": (cut("002.png", 0.999), "002.png", "truncated"),
    "damaged png": (flip("002.png"), "002.png", "damaged"),
    "empty file": (cut("002.png", 0), "002.png", "is not an image"),
    "grey among colours": (image("005.png", GREY), "005.png", "channels"),
    "OpenEXR": (exr, "002.exr", "OpenEXR image: save it as float32 TIFF"),
    "no format that is read": (lambda f: (f / "002.png").write_bytes(b"hello"), "002.png", "PNG, TIFF, JPEG"),
    "blank line before a word": (line(TABLES[1], 1, "\n0 up 1"), TABLES[1], "line 3"),
    "blank line before intensity zero": (line(TABLES[2], 3, "\n1 0 1"), TABLES[2], "line 5"),
    "mask of one pixel": (image("mask.png", np.eye(N, dtype=np.uint8) * (np.arange(N) == 9)), "mask.png", "1 pixel"),
    "alpha": (image("001.png", np.full((N, N, 4), 9_000, np.uint16)), "001.png", "4 channels"),
    "8 bits among 16": (image("005.png", np.full((N, N, 3), 90, np.uint8)), "005.png", "uint8"),
    "black": (image("006.png", np.zeros((N, N, 3), np.uint16)), "006.png", "black"),
    "all black": (lambda folder: every(folder, np.zeros((N, N, 3), np.uint16)), "001.png", "black"),
    "saturated": (lambda folder: every(folder, np.full((N, N, 3), 65535, np.uint16)), "001.png", "overexposed"),
    "list in another encoding": (
        lambda folder: (folder / "filenames.txt").write_bytes("ä.png".encode("latin-1")), "filenames.txt", "UTF-8",
    ),
    "no list": (lambda folder: (folder / "filenames.txt").unlink(), "filenames.txt", "missing"),
    "empty list": (lambda folder: (folder / "filenames.txt").write_text("\n"), "filenames.txt", "no images"),
    "no directions": (lambda folder: (folder / TABLES[1]).unlink(), TABLES[1], "missing"),
    "a direction missing": (line(TABLES[1], 2, None), TABLES[1], "5 rows"),
    "a direction too many": (line(TABLES[1], 2, "0 0 1\n0 0 1"), TABLES[1], "7 rows"),
    "NaN in a direction": (line(TABLES[1], 2, "nan 0 1"), TABLES[1], "line 3"),
    "two numbers": (line(TABLES[1], 0, "0 1"), TABLES[1], "line 1 has 2 numbers"),
    "a word": (line(TABLES[1], 1, "0 up 1"), TABLES[1], "line 2"),
    "zero direction": (line(TABLES[1], 1, "0 0 0"), TABLES[1], "002.png"),
    "intensity zero": (line(TABLES[2], 3, "1 0 1"), TABLES[2], "line 4"),
    "an intensity missing": (line(TABLES[2], 3, None), TABLES[2], "5 rows"),
    "two lights": (first(2, *TABLES), TABLES[1], "three lights"),
    "parallel": (lambda folder: np.savetxt(folder / TABLES[1], np.tile([0.1, 0.2, 1], (6, 1))), TABLES[1], "parallel"),
    "one plane": (
        lambda folder: np.savetxt(folder / TABLES[1], [[i / 9, 0, 1] for i in range(6)]), TABLES[1], "one plane",
    ),
    "no mask": (lambda folder: (folder / "mask.png").unlink(), "mask.png", "missing"),
    "empty mask": (image("mask.png", np.zeros((N, N), np.uint8)), "mask.png", "empty"),
    "mask of another size": (image("mask.png", np.ones((N - 1, N), np.uint8)), "mask.png", "40 × 39"),
    "eval mask empty": (image("eval_mask.png", np.zeros((N, N), np.uint8)), "eval_mask.png", "empty"),
    "truth of another size": (
        lambda folder: np.save(folder / "normals_gt.npy", np.ones((3, 3, 3))), "normals_gt.npy", "(3, 3, 3)",
    ),
    "truth truncated": (
        lambda folder: (np.save(folder / "normals_gt.npy", np.ones((N, N, 3))), cut("normals_gt.npy")(folder)),
        "normals_gt.npy", "read",
    ),
    "truth no matlab file": (lambda f: (f / "Normal_gt.mat").write_bytes(b"x" * 300), "Normal_gt.mat", "read"),
    "truth short": (lambda f: (f / "Normal_gt.mat").write_bytes(b"x" * 15), "Normal_gt.mat", "read"),
    "truth empty": (lambda f: (f / "Normal_gt.mat").touch(), "Normal_gt.mat", "read"),
    "truth damaged": (
        lambda f: (savemat(f / "Normal_gt.mat", {"Normal_gt": DITHER}, do_compression=True), flip("Normal_gt.mat")(f)),
        "Normal_gt.mat", "read",
    ),
    "truth of words": (
        lambda f: np.save(f / "normals_gt.npy", np.full((N, N, 3), "up")), "normals_gt.npy", "real numbers",
    ),
}  # fmt: skip
LP: dict[str, tuple[Damage, str, str]] = {
    "count": (line("lights.lp", 0, "7"), "lights.lp", "7 images, but 6 rows"),
    "no count": (line("lights.lp", 0, None), "lights.lp", "line 1"),
    "count that is no number": (line("lights.lp", 0, "6²"), "lights.lp", "line 1"),
    "empty": (lambda folder: (folder / "lights.lp").write_text(""), "lights.lp", "line 1"),
    "short row": (line("lights.lp", 2, "0 1"), "lights.lp", "line 3"),
    "NaN": (line("lights.lp", 2, "img 1.png 0 inf 1"), "lights.lp", "line 3"),
    "zero": (line("lights.lp", 2, "img 1.png 0 0 0"), "lights.lp", "line 3"),
    "no number": (line("lights.lp", 2, "img 1.png 0 0 up"), "lights.lp", "line 3"),
    "blank line": (line("lights.lp", 2, "\nimg 1.png 0 0 up"), "lights.lp", "line 4"),
    "equal images": (lambda folder: never_switched(folder, 0.0), "img 1.png", "the same values as img 0.png"),
    "lamp never switched": (lambda folder: never_switched(folder, 0.004), "", "never switched"),
    "missing image": (line("lights.lp", 2, "img 9.png 0 0 1"), "img 9.png", "missing"),
    "two lists": (lambda folder: (folder / "other.lp").write_text("0"), "", "other.lp"),
}
NEAR: dict[str, tuple[Damage, str, str]] = {
    "truncated tiff": (cut("2.tiff"), "2.tiff", "truncated"),
    "tiff header only": (cut("2.tiff", 0.002), "2.tiff", "TIFF"),
    "tiff of noise": (lambda folder: (folder / "2.tiff").write_bytes(b"\x17" * 4000), "2.tiff", "TIFF"),
    "two pages": (lambda folder: tifffile.imwrite(folder / "2.tiff", np.stack([GREY, GREY])), "2.tiff", "pages"),
    "planes": (
        lambda folder: tifffile.imwrite(
            folder / "2.tiff", np.stack([GREY] * 3), photometric="rgb", planarconfig="separate"
        ),
        "2.tiff", "planes",
    ),
    "32-bit integers": (lambda folder: tifffile.imwrite(folder / "2.tiff", GREY.astype(np.uint32)), "2.tiff", "uint32"),
    "not a number": (
        lambda folder: [tifffile.imwrite(p, np.full((N, N), np.nan, np.float32)) for p in folder.glob("*.tiff")],
        "0.tiff", "not numbers",
    ),
    "one value no number": (lambda folder: float_images(folder, np.nan), "2.tiff", "row 77, column 40"),
    "one value infinite": (lambda folder: float_images(folder, np.inf), "2.tiff", "row 77, column 40"),
    "one value of the greatest": (lambda folder: float_images(folder, -3.4e38), "2.tiff", "row 77, column 40"),
    "white is zero": (
        lambda folder: tifffile.imwrite(folder / "2.tiff", GREY, photometric="miniswhite"), "2.tiff", "MINISWHITE",
    ),
    "depth in m": (field("depth_mm", 0.48), "lights.json", "depth_mm is 0.48 (in mm"),
    "depth in no unit": (field("depth_mm", 5.2), "lights.json", "depth_mm is 5.2 (in mm"),
    "depth in cm": (field("depth_mm", 48), "lights.json", "all lamps would be behind the object"),
    "positions in µm": (scaled(1e3), "lights.json", "which is impossible"),
    "positions in m": (scaled(1e-3), "lights.json", '`unit` is "mm"'),
    "one position in µm": (field("lights.2.position", [3e5, 1e4, 1e5]), "lights.json", "lights.2.position"),
    "black level of other bits": (field("black_level", 70_000), "0.tiff", "black_level of 70000"),
    "black level above full scale": (
        lambda folder: (field("black_level", 64)(folder), field("full_scale", 60)(folder)), "lights.json", "full_scale",
    ),
    "values above full scale": (field("full_scale", 4095), "0.tiff", "values above 4095"),
    "no json": (lambda folder: (folder / "lights.json").write_text("{"), "lights.json", "JSON"),
    "inches": (field("unit", "in"), "lights.json", "unit"),
    "no reference": (field("reference_mm", 0), "lights.json", "reference_mm"),
    "no position": (field("lights.1.position", [0, 1]), "lights.json", "lights.1.position"),
    "NaN position": (field("lights.1.position", [0, 1, float("nan")]), "lights.json", "lights.1.position"),
    "no intensity": (field("lights.1.intensity", -1), "lights.json", "lights.1.intensity"),
    "no lights": (field("lights", []), "lights.json", "lights"),
    "no camera matrix": (field("camera.K", [[0, 0, 1], [0, 0, 1], [0, 0, 1]]), "lights.json", "camera.K"),
    "skewed camera": (field("camera.K", [[90, 0.5, 20], [0, 90, 20], [0, 0, 1]]), "lights.json", "camera.K"),
    "centre outside": (field("camera.K", [[90, 0, 900], [0, 90, 20], [0, 0, 1]]), "lights.json", "camera.K"),
    "distortion that folds the image": (field("camera.distortion", [-9.0]), "lights.json", "cannot be inverted"),
    "distortion in other units": (field("camera.distortion", [1e6]), "lights.json", "cannot be inverted"),
    "long distortion": (field("camera.distortion", [0.1] * 8), "lights.json", "distortion"),
    "missing": (field("lights.1.file", "nine.tiff"), "nine.tiff", "missing"),
}  # fmt: skip
CASES = [
    pytest.param(make, *case, id=f"{make.__name__}: {name}")
    for make, cases in ((small.diligent, DILIGENT), (small.lp, LP), (small.near, NEAR))
    for name, case in cases.items()
]


@pytest.mark.parametrize(("make", "damage", "file", "said"), CASES)
def test_read_invalid_folder_names_file_and_fault(
    make: Callable[[Path], Path], damage: Damage, file: str, said: str, tmp_path: Path
) -> None:
    folder = make(tmp_path / "in")
    damage(folder)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    with pytest.raises(RigError) as caught:
        folders.read(folder, scratch)
    assert caught.value.code in (ErrorCode.FOLDER_INVALID, ErrorCode.NORMALS_INFEASIBLE)
    assert caught.value.detail.startswith(str(folder / file if file else folder))
    assert said in caught.value.detail
    assert caught.value.context["file"]


def test_kind_of_unknown_folder_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nothing"):
        with pytest.raises(RigError) as caught:
            folders.kind_of(folder)
        assert caught.value.code is ErrorCode.FOLDER_INVALID
        assert str(folder) in caught.value.detail


def test_read_sphere_outside_the_image_is_refused(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    with pytest.raises(RigError, match="sphere"):
        folders.read(folder, tmp_path, sphere=folders.Sphere(500, 500, 3))


def test_values_file_truncated_after_opening_is_named(tmp_path: Path) -> None:
    folder = small.near(tmp_path / "in")
    images = folders.read(folder, tmp_path)
    cut("3.tiff")(folder)
    with pytest.raises(RigError) as caught:
        images.values(3, 0, N)
    assert caught.value.context["file"] == str(folder / "3.tiff")
