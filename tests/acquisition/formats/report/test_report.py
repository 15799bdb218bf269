"""The HTML report is self-contained, its maps are correct, its advice names the side where light is missing."""

import base64
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from acquisition.formats import report
from acquisition.formats.report import advice, pictures
from acquisition.models.result import (
    ATTACHED,
    CAST,
    HIGHLIGHT,
    LIT,
    SATURATED,
    FisherInformation,
    ModelFinding,
    NormalMap,
)

SIZE, LIGHTS = 90, 6
AZIMUTHS = np.radians(np.arange(LIGHTS) * 60.0)
DIRECTIONS = np.stack([0.6 * np.cos(AZIMUTHS), 0.6 * np.sin(AZIMUTHS), np.full(LIGHTS, 0.8)], axis=1)
FACTS = report.ReportContext("A <ball> & more", tuple(f"{number}.png" for number in range(LIGHTS)), DIRECTIONS)


@pytest.fixture
def ball() -> NormalMap:
    """A ball whose every pixel is lit by all lights."""
    row, column = np.mgrid[:SIZE, :SIZE]
    x, y = (column - SIZE / 2) / 40, -(row - SIZE / 2) / 40
    mask = x**2 + y**2 < 0.95
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, None))], -1)
    return NormalMap(
        normals=np.where(mask[..., None], normals, 0).astype(np.float32),
        albedo=np.where(mask, 0.4, 0).astype(np.float32),
        depth=np.where(mask, 0.5, 0).astype(np.float32),
        sigma_deg=np.where(mask, 0.5 + x, np.nan).astype(np.float32),
        residual=np.where(mask, 1, 0).astype(np.float32),
        mask=mask,
        silhouette=mask,
        flags=np.where(mask, LIT, 0).astype(np.uint8) * np.ones((LIGHTS, 1, 1), np.uint8),
        intensity_factors=np.ones(LIGHTS),
        information=FisherInformation(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4, 4))),
        doubtful=np.zeros_like(mask),
    )


def flagged(ball: NormalMap, where: np.ndarray, images: slice, flag: int) -> NormalMap:
    flags = ball.flags.copy()
    flags[images] = np.where(where & ball.mask, flag, flags[images])
    return replace(ball, flags=flags)


class Page(HTMLParser):
    """Collects addresses, scripts and text."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.scripts: list[str] = []
        self.texts: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        (self.scripts if self.open and self.open[-1] == "script" else self.texts).append(data)


def parsed(folder: Path) -> tuple[Page, str]:
    text = (folder / report.PAGE).read_text(encoding="utf-8")
    page = Page()
    page.feed(text)
    return page, text


def test_report_page_is_self_contained(ball: NormalMap, tmp_path: Path) -> None:
    report.write(replace(ball, indirect=np.full((SIZE, SIZE), 0.1, np.float32)), FACTS, tmp_path)
    page, text = parsed(tmp_path)
    assert "http:" not in text
    assert "https:" not in text
    assert "@" not in re.sub(r"@media", "", re.sub(r"base64,[^\"]*", "", text))  # every placeholder is filled
    assert len(page.addresses) == 6
    for address in page.addresses:
        kind, content = address.split(";base64,")
        assert kind == "data:image/png"
        assert cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR) is not None
    assert "A <ball> & more" in "".join(page.texts)
    assert cv2.imread(str(tmp_path / report.PICTURE)) is not None
    assert len(text) < 1_500_000


@pytest.mark.skipif(shutil.which("node") is None, reason="node runs the page's script")
def test_report_script_relights_by_the_rendering_equation(ball: NormalMap, tmp_path: Path) -> None:
    report.write(ball, FACTS, tmp_path)
    page, _ = parsed(tmp_path)
    script = "".join(page.scripts)
    start, end = script.index("function relight"), script.index("function draw")
    script_file = tmp_path / "whole.js"
    script_file.write_text(script)
    assert subprocess.run(["node", "--check", str(script_file)], capture_output=True, check=False).returncode == 0
    probe = tmp_path / "probe.js"
    # One pixel facing the camera, one tilted to +x, one outside; albedo 128, the light from +x at 60° slant.
    probe.write_text(
        script[start:end] + "const n = [128, 128, 255, 255, 255, 128, 128, 255, 0, 0, 0, 255];\n"
        "const a = [128, 128, 255, 255, 128, 128, 255, 255, 0, 0, 0, 255];\n"
        "const l = [Math.sin(Math.PI / 3), 0, 0.5];\n"
        "console.log(JSON.stringify(['own', 'clay', 'gloss'].map(kind => Array.from(relight(n, a, l, kind)))));"
    )
    done = subprocess.run(["node", str(probe)], capture_output=True, text=True, check=True)
    own, clay, gloss = np.array(eval(done.stdout))  # noqa: S307 - numbers that node printed
    assert own[0] == pytest.approx(255 * (0.5 * 128 / 255) ** (1 / 2.2), abs=2)
    assert own[4] == pytest.approx(255 * (np.sin(np.pi / 3) * 128 / 255) ** (1 / 2.2), abs=2)
    assert clay[0] == pytest.approx(255 * (0.5 * 0.75) ** (1 / 2.2), abs=2)
    assert gloss[0] >= clay[0]
    assert own[8:11].tolist() == [238, 238, 236]


def test_reduced_maps_are_means_over_object_pixels(ball: NormalMap) -> None:
    small = pictures.reduced(ball)
    assert small.normals.shape[:2] == small.mask.shape
    assert max(small.mask.shape) <= pictures.MAX_SIDE_PX
    large = NormalMap(
        **{
            name: np.kron(getattr(ball, name), np.ones((10, 10, 1) if name == "normals" else (10, 10))).astype(
                getattr(ball, name).dtype
            )
            for name in ("normals", "albedo", "depth", "sigma_deg", "residual", "mask", "silhouette", "doubtful")
        },
        flags=np.kron(ball.flags, np.ones((1, 10, 10), np.uint8)),
        intensity_factors=ball.intensity_factors,
        information=ball.information,
    )
    small = pictures.reduced(large)
    assert max(small.mask.shape) == pictures.MAX_SIDE_PX
    np.testing.assert_allclose(small.albedo[small.solved], 0.4, rtol=1e-4)
    np.testing.assert_allclose(small.lights[small.mask], LIGHTS, rtol=0.6)
    middle = tuple(size // 2 for size in small.mask.shape)
    np.testing.assert_allclose(small.normals[middle], [0, 0, 1], atol=0.05)


def test_quality_warnings_good_result_is_empty(ball: NormalMap, tmp_path: Path) -> None:
    assert report.quality_warnings(ball, FACTS) == []
    report.write(ball, FACTS, tmp_path)
    assert "No warnings" in "".join(parsed(tmp_path)[0].texts)


@pytest.mark.parametrize(("side", "axis", "sign"), [("right", 0, 1), ("left", 0, -1), ("top", 1, 1), ("bottom", 1, -1)])
def test_quality_warnings_pixels_facing_no_light_name_the_side(
    side: str, axis: int, sign: int, ball: NormalMap
) -> None:
    starved = sign * ball.normals[..., axis] > 0.6
    normal_map = flagged(ball, starved, slice(0, 4), ATTACHED)
    facts = replace(FACTS, directions=np.tile([0.0, 0.0, 1.0], (LIGHTS, 1)))
    sentence = report.quality_warnings(normal_map, facts)[0]
    share = np.count_nonzero(starved & ball.mask) / np.count_nonzero(ball.mask)
    assert sentence.startswith(
        f"{100 * share:.0f} % of the pixels were lit by fewer than three lights: add a light from"
    )
    assert side in sentence


def test_missing_side_repeated_cast_shadow_gives_none(ball: NormalMap) -> None:
    pit = (np.abs(ball.normals[..., 0]) < 0.3) & (np.abs(ball.normals[..., 1]) < 0.3)
    ring = np.radians(np.arange(24) * 15.0)
    everywhere = np.concatenate(
        [
            np.stack([np.sin(s) * np.cos(ring), np.sin(s) * np.sin(ring), np.full(24, np.cos(s))], axis=1)
            for s in np.radians([5, 20, 35, 50, 65])
        ]
    )
    flags = np.where(pit & ball.mask, CAST, ball.flags[:1] * ball.mask).astype(np.uint8)
    normal_map = replace(
        ball, flags=np.repeat(flags, len(everywhere), axis=0), intensity_factors=np.ones(len(everywhere))
    )
    facts = replace(FACTS, names=tuple(str(n) for n in range(len(everywhere))), directions=everywhere)
    assert advice.missing_side(normal_map, pit & ball.mask, everywhere) is None
    assert "no single light would help" in report.quality_warnings(normal_map, facts)[0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda ball: flagged(ball, ball.normals[..., 2] > 0.8, slice(2, 3), SATURATED), "2.png: "),
        (lambda ball: flagged(ball, ball.normals[..., 2] > 0.8, slice(1, 2), LIT | HIGHLIGHT), "glossy"),
        (
            lambda ball: replace(ball, intensity_factors=np.array([1, 1, 1, 0.94, 1, 1])),
            "3.png: its light was 6.0 % dimmer",
        ),
        (
            lambda ball: replace(
                ball, findings=(ModelFinding(kind="misfit", message="the images fit the model badly", corrected=False),)
            ),
            "fit the model badly",
        ),
        (lambda ball: replace(ball, sigma_deg=8 + ball.sigma_deg), "uncertain by more than 5°: add lights"),
        (
            lambda ball: replace(ball, sigma_deg=8 + ball.sigma_deg, noise={"structure_deg": 7.0}),
            "larger images help, more lights do not",
        ),
        (lambda ball: replace(ball, doubtful=ball.mask & (ball.normals[..., 0] > 0)), "σ is unreliable"),
        (lambda ball: replace(ball, indirect=0.4 * ball.mask.astype(np.float32)), "from other surfaces"),
        (lambda ball: flagged(ball, ball.mask, slice(5, 6), 0), "5.png lights only"),
        (lambda ball: flagged(ball, ball.mask, slice(5, 6), CAST), "5.png lights only 0 % of the pixels"),
        (lambda ball: replace(ball, mask=np.zeros_like(ball.mask)), "No pixel could be solved"),
    ],
)
def test_quality_warnings_each_fault_is_stated_in_the_page(
    change: object, said: str, ball: NormalMap, tmp_path: Path
) -> None:
    normal_map = change(ball)  # type: ignore[operator]
    assert any(said in sentence for sentence in report.quality_warnings(normal_map, FACTS))
    report.write(normal_map, FACTS, tmp_path)
    assert said in "".join(parsed(tmp_path)[0].texts)


def test_quality_warnings_lamps_that_differ_much_are_to_be_solved_again(ball: NormalMap) -> None:
    """Unless they are calibrated, or the dark image was left out."""
    differing = replace(ball, intensity_factors=np.array([1, 1, 1, 0.6, 1, 1]))
    left_out = ModelFinding(kind="bad image", message="image 3 is left out", corrected=True, value=3.0)
    for normal_map, known, told in (
        (differing, "assumed", True), (differing, "calibrated", False),
        (replace(differing, findings=(left_out,)), "assumed", False),
    ):  # fmt: skip
        warnings = report.quality_warnings(normal_map, replace(FACTS, intensities=known))
        assert any("by up to a factor of 1.7" in sentence for sentence in warnings) == told


def test_quality_warnings_most_intensities_off_may_be_a_wrong_place(ball: NormalMap) -> None:
    """As of an object that is 100 mm from where it was stated; of distant lights no place is stated."""
    off = replace(ball, intensity_factors=np.array([0.9, 1.1, 0.9, 1.1, 0.98, 1.02]))
    distant = replace(off, notes={"depth_unit": "pixel"})
    few = replace(ball, intensity_factors=np.array([0.9, 1.1, 1, 1, 1, 1]))
    for normal_map, known, told in (
        (off, "stated", True), (off, "assumed", False), (distant, "stated", False), (few, "stated", False),
    ):  # fmt: skip
        warnings = report.quality_warnings(normal_map, replace(FACTS, intensities=known))
        assert any("rough depth or the lamps' positions are wrong" in sentence for sentence in warnings) == told


def test_report_page_states_figures_and_lights(ball: NormalMap, tmp_path: Path) -> None:
    facts = replace(
        FACTS, groups=("first pass",) * 4 + ("planned",) * 2, solver="weighted", why="least residual",
        seconds={"solve": 1.25}, predicted_sigma_deg=0.61, error_deg={"mean": 0.55}, warnings=("Mind the gap.",),
    )  # fmt: skip
    report.write(ball, facts, tmp_path)
    page, text = parsed(tmp_path)
    words = " ".join(page.texts)
    for part in ("0.61°", "mean 0.55°", "weighted: least residual", "solve 1.25 s", "Mind the gap.", "planned", "37°"):
        assert part in words, part
    assert text.count('class="light kind') == LIGHTS


def test_report_page_contains_drawings_of_the_capture(ball: NormalMap, tmp_path: Path) -> None:
    svg = '<svg viewBox="0 0 10 10" role="img" aria-label="cell from above"><path d="M1 1L9 9" /></svg>'
    report.write(ball, replace(FACTS, drawings=(("Cell <from> above", svg),)), tmp_path)
    page = (tmp_path / report.PAGE).read_text(encoding="utf-8")
    assert f"<figure>{svg}<figcaption>Cell &lt;from&gt; above</figcaption></figure>" in page
    report.write(ball, FACTS, tmp_path)
    assert "cell from above" not in (tmp_path / report.PAGE).read_text(encoding="utf-8")
