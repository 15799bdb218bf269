"""The jobs of the compute process: each calls one pure stage; large data are files in the session folder.

Pilot, plan, route and solve are combined only here and in the runner. The functions are at module level and take small
arguments, because they are called in the process by name. They return values of `models`, which the web process can
read without importing a stage.
"""

import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from acquisition import geometry, lamp_pose, photometry, pilot, plan
from acquisition.capture import check, expected, region
from acquisition.formats import export, report
from acquisition.formats.atomic_write import discard_partial, publish
from acquisition.formats.folders import session_folder
from acquisition.models.base import BoolArray, FloatArray, Joints, Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_check import CheckState
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.light_forecast import ForecastInput, LightForecast
from acquisition.models.light_plan import Light, LightPlan, PriorForecast
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap, ResultSummary, SolveSettings
from acquisition.models.route import JointPath, Route
from acquisition.models.shot import Observations
from acquisition.normals.images import colour_albedo
from acquisition.plan import baselines, visibility
from acquisition.plan import prior_forecast as prior
from acquisition.plan.design_problem import positions_of
from acquisition.plan.explain import Basis
from acquisition.runner import light_forecast
from acquisition.runner.board_jobs import board_moved, board_poses, estimate_from_board, look_at_board
from acquisition.runner.check_jobs import check_poses, estimate_check
from acquisition.runner.lamp_jobs import estimate_lamp, lamp_poses, look_at_target, target_moved
from acquisition.runner.response_jobs import estimate_response, response_light
from acquisition.runner.session_solve import solve_in_cell
from acquisition.waypoints import drawing, rejoin, routing
from acquisition.waypoints import jog_step as jog_steps
from acquisition.waypoints import reach as reaching

__all__ = [
    "board_moved", "board_poses", "check_poses", "estimate_check", "estimate_from_board", "estimate_lamp",
    "estimate_response", "lamp_poses", "look_at_board", "look_at_target", "response_light", "target_moved",
]  # jobs of modules of their own  # fmt: skip

Rows = npt.NDArray[np.int64]

PictureForm = Literal["png", "html"]

_TOP_PERCENTILE = 99.0
"""Percentile of all pixels' heights taken as the object's top; single pixels at discontinuities are too high."""
FORECAST_COUNTS = (1, 2, 4, 8, 16)
"""Numbers of further lights for which a plan forecasts the error."""
ASSUMED_MOVE_S = 2.0
"""Time, s, assumed of a move between two lights if no route is on record."""
FRAME_S = 0.1
"""Time, s, of a frame beside its exposure: readout, transfer, check, file and journal."""


def make_reach(cell: CellConfig, calibration: Calibration, cache: Path) -> None:
    """Computes the cell's reach and stores it in the cache file, unless it is there."""
    _reach(cell, calibration, cache)


def _reach(cell: CellConfig, calibration: Calibration, cache: Path) -> reaching.ReachMap:
    if cache.exists():
        cached = reaching.ReachMap.model_validate_json(cache.read_bytes())
        if cached.cell == cell and cached.calibration == calibration:
            return cached
    reach_map = reaching.reach(cell, calibration)
    partial = cache.with_suffix(".part")
    partial.write_text(reach_map.model_dump_json(), encoding="utf-8")
    publish(partial, cache)
    return reach_map


def first_lights(recipe: Recipe, cell: CellConfig, calibration: Calibration, cache: Path) -> LightPlan:
    """Returns the lights of the first pass: the pilot's, or all lights of a recipe without a pilot."""
    reach = _reach(cell, calibration, cache)
    if recipe.method == "user":
        return baselines.user_lights(recipe, reach)
    if recipe.method != "optimal":
        return baselines.baseline(recipe.method, recipe.lights_total, recipe, reach)
    lights = pilot.pattern(recipe, reach)
    slants = np.degrees(geometry.slant_azimuth(positions_of(lights) - reach.center)[0])
    return LightPlan(
        lights=lights,
        method="pilot",
        reasons=[f"pilot light at slant {slant:.0f}°" for slant in slants],
        notes=[f"The light nearest to the view axis stands at slant {min(slants):.1f}°."],
    )


def prior_forecast(
    recipe: Recipe, cell: CellConfig, calibration: Calibration, cache: Path, first: Sequence[Light]
) -> PriorForecast:
    """Forecasts σ against the number of images before the first one, for the largest sphere that fits the keep-out."""
    keep_out = cell.object.keep_out
    radius_m = min(keep_out.radius_m, keep_out.height_m / 2)
    return prior.forecast(recipe, first, _reach(cell, calibration, cache), calibration, radius_m)


def further_lights(
    recipe: Recipe, cell: CellConfig, calibration: Calibration, cache: Path, result: Path, observations: Observations,
    region_file: Path | None,
) -> tuple[LightPlan, list[bytes]]:  # fmt: skip
    """Plans the next pass's lights from the last result, with a picture (PNG) of each light's gain.

    `region_file` is the mask of the region of interest (None: the whole object). Raises RigError as
    `require_within_keep_out`.
    """
    normal_map = export.read(result)
    require_within_keep_out(normal_map, cell, calibration)
    reach = _reach(cell, calibration, cache)
    region_mask = _region_mask(region_file, calibration)
    times = _capture_times(cell, _routes(result.parent.parent, int(result.name)))
    achieved_deg = recipe.target_sigma_deg and photometry.mean_sigma_deg(normal_map, calibration, region_mask)
    problem = plan.DesignProblem.of(normal_map, observations, recipe, reach, calibration, region=region_mask)
    if achieved_deg is None:
        chosen = plan.choose(problem, times=times, forecast_counts=FORECAST_COUNTS)
    else:
        chosen = plan.plan_to_target(problem, achieved_deg, times)
    if not chosen.lights:
        return chosen, []
    positions = positions_of(chosen.lights)
    basis = Basis.of(problem, normal_map, observations, calibration)
    pictures, brightest_deg = basis.gain_pictures(positions)
    summary = {
        "levels_per_s": expected_levels(normal_map, chosen.lights, calibration),
        "brightest_gain_deg": brightest_deg,
    }
    return chosen.model_copy(update=summary), pictures


def _capture_times(cell: CellConfig, routes: Sequence[Route]) -> plan.CaptureTimes:
    """Returns limits and times of a cell's captures; the time between two lights is the mean over the routes so far."""
    moving_s = [route.seconds / (len(route.waypoints) + 1) for route in routes if route.waypoints]
    return plan.CaptureTimes(
        shortest_s=cell.camera.min_exposure_s,
        longest_s=cell.camera.max_exposure_s,
        move_s=cell.arm.settle_s + cell.lamp.rise_s + (float(np.mean(moving_s)) if moving_s else ASSUMED_MOVE_S),
        frame_s=FRAME_S,
    )


def require_within_keep_out(normal_map: NormalMap, cell: CellConfig, calibration: Calibration) -> None:
    """Raises RigError config.invalid if the measured object is higher than its keep-out by over half the clearance.

    The session then ends, and no path is planned round the measured surface: the same keep-out holds for parking, for
    the path home and for the next session, and only a person who corrects the cell file makes all of them safe.
    """
    rays = photometry.rays(calibration, slice(0, calibration.height), slice(0, calibration.width))
    reliable = normal_map.mask & ~normal_map.doubtful
    if not reliable.any():
        return
    points = photometry.points(rays, normal_map.depth)[:, reliable].T
    keep_out = cell.object.keep_out
    object_from_view = geometry.inverse(keep_out.base_from_object.matrix) @ lamp_pose.base_from_view(calibration)
    top_m = float(np.percentile(geometry.transform(object_from_view, points)[:, 2], _TOP_PERCENTILE))
    if top_m > keep_out.height_m + cell.clearances.object_m / 2:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"The images show an object {1e3 * top_m:.0f} mm high, but its keep-out in the cell file is only "
            f"{1e3 * keep_out.height_m:.0f} mm high, and the arm would pass close to it. Nothing was moved. Measure "
            "the object, correct `[object] keep_out`, then bring the arm home by hand or by a parking session.",
            measured_top_m=round(top_m, 4),
            keep_out_height_m=keep_out.height_m,
        )


def _region_mask(mask: Path | None, calibration: Calibration) -> BoolArray | None:
    return None if mask is None else region.decode_mask(mask.read_bytes(), calibration)


def expected_levels(normal_map: NormalMap, lights: list[Light], calibration: Calibration) -> list[float]:
    """Returns each light's level: the 99.5th percentile of the signal over the solved pixels, of the brightest channel,
    fraction of full scale per second. Pixels that the object itself shades count as dark."""
    rows, columns = np.nonzero(normal_map.mask)
    step = max(1, len(rows) // 20_000)
    pixels = rows[::step], columns[::step]
    signal = _signal(normal_map, lights, calibration, pixels)
    signal = np.where(visibility.shaded(normal_map, lights, calibration, pixels), 0.0, signal)
    channels = [signal * ratio for ratio in colour_albedo.channel_ratios(normal_map, calibration, *pixels)]
    levels = np.max([np.percentile(one, check.BRIGHT_PERCENTILE, axis=1) for one in channels], axis=0)
    return [float(value) for value in levels]


def predict_images(lights: list[Light], calibration: Calibration, result: Path) -> list[bytes]:
    """Predicts a small image (16-bit PNG, brightest 65535) of the object under each light, from a stored result."""
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
    """Returns the signal (F, K) of lights at some pixels, fraction of full scale per second, without cast shadows."""
    rows, columns = pixels
    ray = photometry.rays(calibration, slice(0, calibration.height), slice(0, calibration.width))
    point = photometry.points(ray, normal_map.depth)[:, rows, columns]
    vectors = photometry.light_vectors(point, photometry.lamps(lights), calibration)
    facing = np.einsum("fck,kc->fk", vectors, normal_map.normals[rows, columns])
    return normal_map.albedo[rows, columns] * np.clip(facing, 0, None) * calibration.lamp_intensity


def plan_route(lights: list[Light], start: tuple[float, ...], cell: CellConfig, calibration: Calibration) -> Route:
    """Plans certified joint paths from `start` (rad) through the lights and home."""
    return routing.route(lights, start, cell, calibration)


def plan_route_on_the_way(
    lights: list[Light], start: tuple[float, ...], cell: CellConfig, calibration: Calibration
) -> Route:
    """As `plan_route`, for images on the way; searches longer, because moves take nearly all of the time."""
    return routing.route(lights, start, cell, calibration, routing.DENSE_NODES)


def plan_route_of_views(
    lights: list[Light], joints: list[Joints], start: tuple[float, ...], cell: CellConfig, calibration: Calibration
) -> Route:
    """Plans certified joint paths from `start` (rad) through views of the calibration board and home."""
    return routing.route_of_views(lights, joints, start, cell, calibration)


def rejoin_route(
    route: Route, left: tuple[int, ...], start: tuple[float, ...], cell: CellConfig, calibration: Calibration
) -> Route:
    """Returns the rest of a route, with a path to it from where the arm stands now (`start`, rad)."""
    return rejoin.rejoin(route, left, start, cell, calibration)


def plan_return(
    start: tuple[float, ...], end: tuple[float, ...], cell: CellConfig, calibration: Calibration
) -> JointPath:
    """Plans a certified joint path from `start` back to `end`, where the arm was before (rad)."""
    return routing.path_between(start, end, cell, calibration)


def own_lights(
    positions: list[Vector3], cell: CellConfig, calibration: Calibration, cache: Path, previous: Path | None,
    start: tuple[float, ...],
) -> tuple[LightPlan, Route]:  # fmt: skip
    """Makes a plan of a person's own lights (m, view frame), and its route; `previous` is the last result.

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


def forecast_lights(
    key: str, given: ForecastInput, cache: Path, positions: list[Vector3]
) -> tuple[LightForecast, bytes | None]:
    """Forecasts σ for lights that a person places (m, view frame), with a picture (PNG; None without a result)."""
    return light_forecast.forecast(key, given, _reach(given.cell, given.calibration, cache), positions)


def plan_retreat(start: tuple[float, ...], cell: CellConfig, calibration: Calibration) -> JointPath:
    """Plans a certified joint path home from `start` (rad)."""
    return routing.retreat(start, cell, calibration)


def jog_step(joints: tuple[float, ...], motion: JogMotion, cell: CellConfig, calibration: Calibration) -> JointPath:
    """Plans a certified step of jogging from `joints` (rad)."""
    return jog_steps.jog_step(joints, motion, cell, calibration)


def draw_reach(cell: CellConfig, calibration: Calibration, cache: Path, form: PictureForm) -> bytes:
    """Draws the cell's reach."""
    reach = _reach(cell, calibration, cache)
    return drawing.reach_png(reach) if form == "png" else drawing.reach_html(reach).encode()


def draw_route(route: Route, cell: CellConfig, calibration: Calibration, form: PictureForm) -> bytes:
    """Draws a route in its cell."""
    if form == "png":
        return drawing.route_png(route, cell, calibration)
    return drawing.route_html(route, cell, calibration).encode()


def make_export(observations: Observations, calibration: Calibration, result: Path, name: str) -> None:
    """Makes one export of a stored result, `result`/exports/`name`, unless it is there; a folder becomes a zip file."""
    file = result / "exports" / name
    if file.exists():
        return
    normal_map = export.read(result)
    source = export.Source(normal_map, session_folder.images(observations, calibration, normal_map.silhouette))
    file.parent.mkdir(exist_ok=True)
    discard_partial(file)
    with tempfile.TemporaryDirectory(prefix=f".{name}.", dir=file.parent) as partial:
        stem = name.removesuffix(".zip") if name.endswith(".zip") else name
        export.make(stem, source, Path(partial))
        if name.endswith(".zip"):
            shutil.make_archive(str(Path(partial) / stem), "zip", Path(partial) / stem)
        publish(Path(partial) / name, file)


def _facts(
    normal_map: NormalMap, observations: Observations, cell: CellConfig, calibration: Calibration,
    forecast: LightPlan | None, folder: Path, seconds: dict[str, float],
) -> report.ReportContext:  # fmt: skip
    """Collects what the report of a result states beside the maps; `folder` is sessions/<id>/results/<number>."""
    session = folder.parent.parent
    images = session_folder.images(observations, calibration, normal_map.silhouette)
    passes = [shot.key.pass_number for shot in observations.shots if shot.light is not None]
    return report.ReportContext(
        title=f"Session {session.name}, result {folder.name}",
        names=images.names,
        directions=export.Source(normal_map, images).directions,
        groups=tuple("first pass" if number == 0 else "planned" for number in passes),
        solver=str(normal_map.notes.get("solver", "")),
        why=str(normal_map.notes.get("why", "")),
        seconds=seconds,
        predicted_sigma_deg=None if forecast is None else forecast.predicted_sigma_deg,
        drawings=tuple(drawing.svg_views(_routes(session, max(passes, default=0)), cell, calibration)),
    )


def report_calibration(folder: Path, title: str, facts: dict[str, str], advice: Sequence[str]) -> None:
    """Writes the report of a calibration's estimate into its folder."""
    report.write_calibration(folder, title, facts, advice)


def _routes(session: Path, last_pass: int) -> list[Route]:
    """Returns each pass's full route, the longest one; shorter ones are rests after an interruption."""
    routes: list[Route] = []
    for number in range(last_pass + 1):
        files = sorted((session / f"passes/{number}").glob("route*.json"), reverse=True)
        planned = [Route.model_validate_json(file.read_bytes()) for file in files]
        routes += [max(planned, key=lambda route: len(route.waypoints))] if planned else []
    return routes


def solve_normals(
    observations: Observations, cell: CellConfig, calibration: Calibration, settings: SolveSettings,
    forecast: LightPlan | None, region_file: Path | None, folder: Path, check: CheckState | None = None,
) -> ResultSummary:  # fmt: skip
    """Solves all images and writes the result into `folder`. `region_file` is the mask of the region of interest, if
    any, and `check` the state of the calibration by its checks."""
    begun = time.monotonic()
    normal_map = solve_in_cell(observations, cell, calibration, settings)
    seconds = {"solve": time.monotonic() - begun}
    sigma = photometry.facing_sigma_deg(normal_map, calibration)
    mean_sigma_deg = float(np.mean(sigma, dtype=np.float64))
    discard_partial(folder)
    with export.atomic_folder(folder) as partial:
        export.write_into(normal_map, partial)
        facts = _facts(normal_map, observations, cell, calibration, forecast, folder, seconds)
        facts = replace(facts, facing_sigma_deg=mean_sigma_deg)
        if check is not None:
            facts = replace(facts, calibration_checked=check.sentence, warnings=tuple(check.warnings))
        report.write(normal_map, facts, partial)
    lights_used = export.lights_used(normal_map)[normal_map.silhouette]
    return ResultSummary(
        images=len(observations.shots),
        object_pixels=int(np.count_nonzero(normal_map.silhouette)),
        solved_pixels=int(np.count_nonzero(normal_map.mask)),
        mean_sigma_deg=mean_sigma_deg,
        median_sigma_deg=float(np.median(sigma)),
        region_sigma_deg=None
        if region_file is None
        else photometry.mean_sigma_deg(normal_map, calibration, _region_mask(region_file, calibration)),
        predicted_sigma_deg=None if forecast is None else forecast.predicted_sigma_deg,
        predicted_median_deg=None if forecast is None else forecast.predicted_median_deg,
        fewer_than_three_lights=float(np.mean(lights_used < 3)),
        intensity_factors=[float(factor) for factor in normal_map.intensity_factors],
        noise=normal_map.noise,
        fit=normal_map.fit,
        findings=list(normal_map.findings),
    )
