"""The jobs of the compute process: each calls one pure stage, with files in the session folder for what is large.

Pilot, plan, route and solve meet here and in the runner only. The functions are module level and their arguments small,
so that they cross to the process by name; what they return is a value of `types`, which the web process can read
without importing a stage.
"""

import shutil
import tempfile
import time
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from acquisition import geometry, lamp_pose, photometry, pilot, plan, report
from acquisition.capture import check, expected, region
from acquisition.formats import export
from acquisition.formats.export import lights as light_files
from acquisition.formats.folders import session as session_images
from acquisition.models.base import BoolArray, FloatArray, Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap, ResultSummary, SolveSettings
from acquisition.models.route import JointPath, Route
from acquisition.models.shot import Observations
from acquisition.plan import baselines, explain, visibility
from acquisition.runner.session_solve import solve_in_cell
from acquisition.waypoints import reach as reaching
from acquisition.waypoints import rejoin, sketch
from acquisition.waypoints import route as routing


def make_reach(cell: CellConfig, calibration: Calibration, cache: Path) -> None:
    """Makes the cell's reach and keeps it in the cache file, unless it is there."""
    _reach(cell, calibration, cache)


def _reach(cell: CellConfig, calibration: Calibration, cache: Path) -> reaching.ReachMap:
    if cache.exists():
        kept = reaching.ReachMap.model_validate_json(cache.read_bytes())
        if kept.cell == cell and kept.calibration == calibration:
            return kept
    found = reaching.reach(cell, calibration)
    beside = cache.with_suffix(".part")
    beside.write_text(found.model_dump_json(), encoding="utf-8")
    beside.rename(cache)
    return found


Rows = npt.NDArray[np.int64]

PictureForm = Literal["png", "html"]

_TOP_PERCENTILE = 99.0
"""Of the heights of all pixels: single ones at steps are integrated too high."""
FORECAST_COUNTS = (1, 2, 4, 8, 16)
"""Numbers of further lights for which a plan tells what is to be expected."""


def first_lights(recipe: Recipe, cell: CellConfig, calibration: Calibration, cache: Path) -> LightPlan:
    """The lights of the first pass: the pilot's, or all those of a pattern."""
    reach = _reach(cell, calibration, cache)
    if recipe.method != "optimal":
        return baselines.baseline(recipe.method, recipe.lights_total, recipe, reach)
    lights = pilot.pattern(recipe, reach)
    slants = np.degrees(geometry.slant_azimuth(np.array([light.position for light in lights]) - reach.center)[0])
    return LightPlan(
        lights=lights,
        method="pilot",
        reasons=[f"pilot light at slant {slant:.0f}°" for slant in slants],
        notes=[f"The light nearest to the view axis stands at slant {min(slants):.1f}°."],
    )


def further_lights(
    recipe: Recipe, cell: CellConfig, calibration: Calibration, cache: Path, result: Path, observations: Observations,
    drawn: Path | None,
) -> tuple[LightPlan, list[bytes]]:  # fmt: skip
    """The next pass's lights, planned from the last result, and for each a picture (PNG) of what it gains.

    `drawn` is the mask of the region of interest, none: the whole object. Raises RigError config.invalid when the
    object is seen to be higher than its keep-out.
    """
    normal_map = export.read(result)
    require_within_keep_out(normal_map, cell, calibration)
    reach = _reach(cell, calibration, cache)
    known, wanted_part = (normal_map, observations, recipe, reach, calibration), _drawn(drawn, calibration)
    if recipe.target_sigma_deg is None:
        chosen = plan.choose(*known, region=wanted_part, forecast_counts=FORECAST_COUNTS)
    else:
        chosen = plan.approach(*known, region=wanted_part)
    if not chosen.lights:
        return chosen, []
    found = explain.gains(normal_map, observations, recipe, chosen.lights, calibration)
    pictures = [explain.picture(found, light, normal_map.silhouette) for light in range(len(chosen.lights))]
    told = {
        "levels_per_s": expected_levels(normal_map, chosen.lights, calibration),
        "brightest_gain_deg": found.brightest_deg,
    }
    return chosen.model_copy(update=told), pictures


def require_within_keep_out(normal_map: NormalMap, cell: CellConfig, calibration: Calibration) -> None:
    """Raises RigError config.invalid when the measured object takes half its clearance from the arm, or more.

    The session ends, and no way is planned round what was measured: the same keep-out holds for parking, for the way
    home and for the next session, and only a person who corrects the cell file makes all of them safe.
    """
    rays = photometry.rays(calibration, slice(0, calibration.height), slice(0, calibration.width))
    sure = normal_map.mask if normal_map.doubtful is None else normal_map.mask & ~normal_map.doubtful
    if not sure.any():
        return
    points = photometry.points(rays, normal_map.depth)[:, sure].T
    keep_out = cell.object.keep_out
    object_from_view = geometry.inverse(keep_out.base_from_object.matrix) @ lamp_pose.base_from_view(calibration)
    top_m = float(np.percentile(geometry.transform(object_from_view, points)[:, 2], _TOP_PERCENTILE))
    if top_m > keep_out.height_m + cell.clearances.object_m / 2:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"The object is {1e3 * top_m:.0f} mm high by its images, its keep-out in the cell file only "
            f"{1e3 * keep_out.height_m:.0f} mm, and the arm was to move close to that. Nothing was moved. Measure the "
            "object, correct `[object] keep_out`, and bring the arm home by hand or by a parking session then.",
            measured_top_m=round(top_m, 4),
            keep_out_height_m=keep_out.height_m,
        )


def _drawn(mask: Path | None, calibration: Calibration) -> BoolArray | None:
    return None if mask is None else region.decode_mask(mask.read_bytes(), calibration)


def expected_levels(normal_map: NormalMap, lights: list[Light], calibration: Calibration) -> list[float]:
    """For each light the 99.5th percentile of the signal over the solved pixels, fraction of full scale per second;
    pixels that the object itself shades count as dark."""
    rows, columns = np.nonzero(normal_map.mask)
    step = max(1, len(rows) // 20_000)
    pixels = rows[::step], columns[::step]
    signal = _signal(normal_map, lights, calibration, pixels)
    signal = np.where(visibility.shaded(normal_map, lights, calibration, pixels), 0.0, signal)
    return [float(value) for value in np.percentile(signal, check.BRIGHT_PERCENTILE, axis=1)]


def predict_images(lights: list[Light], calibration: Calibration, result: Path) -> list[bytes]:
    """For each light a small picture (16-bit PNG, brightest 65535) of the object under it, by a stored result."""
    normal_map = export.read(result)
    rows, columns = np.nonzero(normal_map.mask)
    pictures: list[bytes] = []
    for light in lights:
        picture = np.zeros(normal_map.mask.shape)
        picture[rows, columns] = _signal(normal_map, [light], calibration, (rows, columns))[0]
        pictures.append(expected.encode_image(picture))
    return pictures


def _signal(
    normal_map: NormalMap, lights: list[Light], calibration: Calibration, pixels: tuple[Rows, Rows]
) -> FloatArray:
    """The signal (F, K) of lights at some pixels, fraction of full scale per second, shadows left out."""
    rows, columns = pixels
    ray = photometry.rays(calibration, slice(0, calibration.height), slice(0, calibration.width))
    point = photometry.points(ray, normal_map.depth)[:, rows, columns]
    vectors = photometry.light_vectors(point, photometry.lamps(lights), calibration)
    facing = np.einsum("fck,kc->fk", vectors, normal_map.normals[rows, columns])
    return normal_map.albedo[rows, columns] * np.clip(facing, 0, None) * calibration.lamp_intensity


def plan_route(lights: list[Light], start: tuple[float, ...], cell: CellConfig, calibration: Calibration) -> Route:
    """Certified joint paths from `start` (rad) through the lights and home."""
    return routing.route(lights, start, cell, calibration)


def rejoin_route(
    route: Route, left: tuple[int, ...], start: tuple[float, ...], cell: CellConfig, calibration: Calibration
) -> Route:
    """What is left of a route, from where the arm stands now (rad)."""
    return rejoin.rejoin(route, left, start, cell, calibration)


def plan_return(
    start: tuple[float, ...], end: tuple[float, ...], cell: CellConfig, calibration: Calibration
) -> JointPath:
    """A certified joint path from `start` to where the arm was before (rad)."""
    return routing.way(start, end, cell, calibration)


def own_lights(
    positions: list[Vector3], cell: CellConfig, calibration: Calibration, cache: Path, previous: Path | None,
    start: tuple[float, ...],
) -> tuple[LightPlan, Route]:  # fmt: skip
    """A person's own lights (m, view frame) as a plan, and the route through them; `previous` is the last result.

    Raises RigError waypoints.unreachable, waypoints.collision, naming the lights.
    """
    center = _reach(cell, calibration, cache).center
    lights = [lamp_pose.light_at(np.array(position), center) for position in positions]
    route = routing.route(lights, start, cell, calibration)
    levels = None if previous is None else expected_levels(export.read(previous), lights, calibration)
    plan = LightPlan(
        lights=lights, method="user", reasons=["given by a person in place of the planned lights"] * len(lights),
        levels_per_s=levels,
    )  # fmt: skip
    return plan, route


def plan_retreat(start: tuple[float, ...], cell: CellConfig, calibration: Calibration) -> JointPath:
    """A certified joint path home from `start` (rad)."""
    return routing.retreat(start, cell, calibration)


def draw_reach(cell: CellConfig, calibration: Calibration, cache: Path, form: PictureForm) -> bytes:
    """A picture of the cell's reach."""
    from acquisition.waypoints import picture  # noqa: PLC0415 - what draws is slow to load and seldom wanted

    reach = _reach(cell, calibration, cache)
    return picture.reach_still(reach) if form == "png" else picture.reach_page(reach).encode()


def draw_route(route: Route, cell: CellConfig, calibration: Calibration, form: PictureForm) -> bytes:
    """A picture of a route in its cell."""
    from acquisition.waypoints import picture  # noqa: PLC0415 - what draws is slow to load and seldom wanted

    if form == "png":
        return picture.route_still(route, cell, calibration)
    return picture.route_page(route, cell, calibration).encode()


def make_export(observations: Observations, calibration: Calibration, result: Path, name: str) -> None:
    """Makes one export of a stored result, `result`/exports/`name`, unless it is there; a folder becomes a zip file."""
    made = result / "exports" / name
    if made.exists():
        return
    found = export.read(result)
    source = export.Source(found, session_images.images(observations, calibration, found.silhouette))
    made.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=made.parent) as partial:
        stem = name.removesuffix(".zip") if name.endswith(".zip") else name
        export.make(stem, source, Path(partial))
        if name.endswith(".zip"):
            shutil.make_archive(str(Path(partial) / stem), "zip", Path(partial) / stem)
        (Path(partial) / name).rename(made)


def _facts(
    found: NormalMap, observations: Observations, cell: CellConfig, calibration: Calibration,
    forecast: LightPlan | None, folder: Path, seconds: dict[str, float],
) -> report.Facts:  # fmt: skip
    """What the report of a session's result says beside the maps; the folder is sessions/<id>/results/<number>."""
    session = folder.parent.parent
    images = session_images.images(observations, calibration, found.silhouette)
    passes = [shot.key.pass_number for shot in observations.shots if shot.light is not None]
    return report.Facts(
        title=f"Session {session.name}, result {folder.name}",
        names=images.names,
        directions=light_files.directions(images, export.Source(found, images).centre),
        groups=tuple("first pass" if number == 0 else "planned" for number in passes),
        solver=str(found.notes.get("solver", "")),
        why=str(found.notes.get("why", "")),
        seconds=seconds,
        predicted_sigma_deg=None if forecast is None else forecast.predicted_sigma_deg,
        drawings=tuple(sketch.views(_routes(session, max(passes, default=0)), cell, calibration)),
    )


def _routes(session: Path, last_pass: int) -> list[Route]:
    """Each pass's whole route; shorter ones are what was left after an interruption."""
    whole: list[Route] = []
    for number in range(last_pass + 1):
        files = sorted((session / f"passes/{number}").glob("route*.json"), reverse=True)
        made = [Route.model_validate_json(file.read_bytes()) for file in files]
        whole += [max(made, key=lambda route: len(route.waypoints))] if made else []
    return whole


def solve_normals(
    observations: Observations, cell: CellConfig, calibration: Calibration, settings: SolveSettings,
    forecast: LightPlan | None, drawn: Path | None, folder: Path,
) -> ResultSummary:  # fmt: skip
    """Solves all images and writes the result into `folder`; `drawn` is the mask of the region of interest, if any."""
    begun = time.monotonic()
    found = solve_in_cell(observations, cell, calibration, settings)
    seconds = {"solve": time.monotonic() - begun}
    with export.whole_folder(folder) as partial:
        export.write_into(found, partial)
        report.write(found, _facts(found, observations, cell, calibration, forecast, folder, seconds), partial)
    sigma = found.sigma_deg[found.mask]
    lights_used = export.lights_used(found)[found.silhouette]
    return ResultSummary(
        images=len(observations.shots),
        object_pixels=int(np.count_nonzero(found.silhouette)),
        solved_pixels=int(np.count_nonzero(found.mask)),
        mean_sigma_deg=photometry.mean_sigma_deg(found, calibration),
        median_sigma_deg=float(np.median(sigma)),
        region_sigma_deg=None
        if drawn is None
        else photometry.mean_sigma_deg(found, calibration, _drawn(drawn, calibration)),
        predicted_sigma_deg=None if forecast is None else forecast.predicted_sigma_deg,
        predicted_median_deg=None if forecast is None else forecast.predicted_median_deg,
        fewer_than_three_lights=float(np.mean(lights_used < 3)),
        intensity_factors=[float(factor) for factor in found.intensity_factors],
        noise=found.noise,
    )
