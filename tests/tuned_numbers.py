"""Finds the numbers of solver and planner, and says which are tuned: `python -m tests.tuned_numbers` counts them.

A tuned number is a field of a module's frozen `SETTINGS` (`acquisition.models.tuned`). Any other number at a module's
level has to be named here with the reason why it is none; those in functions that are not plain (0, 1, 2, 3, 4, halves
and quarters, whole numbers, guards against division by zero) are counted by module. `INLINE` is what is still to be
moved or justified: it only shrinks.
"""

import ast
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

ACQUISITION = Path(__file__).parents[1] / "acquisition"
PLAIN = (0, 1, 2, 3, 4, 0.25, 0.5, 1.5)
GUARD = 1e-5
"""Powers of ten up to which a number in a function is a guard against division by zero."""

REASONS: dict[str, str] = {
    "physics, statistics, standards and formulas": """
        silhouette.WITHIN_SIGMA distant.LUMA image_set.EIGHT_BIT_SCALE goodness_of_fit.GAUSSIAN_MEDIAN_SQUARE
        microfacet.F0 microfacet.METAL_F0 photon_transfer.CLIP_SIGMA photon_transfer.CLIPPED_GAUSSIAN_VARIANCE
        photometry.GAUSSIAN_MEDIAN_DEVIATION self_calibration.STRONG_EVIDENCE surface_diffusion.MAX_EIGENVALUE
        pixel_solve_kernels.CAUCHY_COVARIANCE_FACTOR
        discontinuity.NEIGHBOUR_SINE baselines.DRBOHLAV_SLANT_DEG baselines.INNER_SLANT_DEG baselines.OUTER_SLANT_DEG
        light_tests.STATED_AXES light_tests.SIDES light_tests.QUARTER_AXES
        error_variance.FOUR_NEIGHBOURS planned_images.INTEGRABILITY_SHARE
        error_variance.NOISE_DETAIL error_variance.CREASE error_variance.DETAIL error_variance.MISFIT
        error_variance.NOISE_LINE error_variance.LINE error_variance.LINES_PX error_variance.POSTERIOR
        photometry.RANDOM_NORMAL_SIGMA_DEG photometry.RANDOM_NORMAL_VARIANCE
        photometry.CAUCHY_SCALE term_alternatives.CODED_EXPONENTS image_terms.ROUGH_WEIGHTS image_terms.FACET_SLOPES_RAD
        translucency.NEAR_PX""",
    "counts of unknowns, marks and definitions": """
        light_tests.NEAR light_tests.INWARDS image_terms.NEARLY_DIFFUSE
        alternative.FOUND_SHARE alternative.AS_GOOD
        term_tests.OFFSET
        photometry.PIXEL_UNKNOWNS image_values.SATURATION_SHARE photometry.GRADED_SLANT_DEG changed_images.HALF
        reflectance_kernels.BASIS_SIZE
        goodness_of_fit.GRID error_variance.POOLED_PX baselines.FAR_DEG
        reflectance_solve.UNKNOWN_VARIANCE_RAD2 distant.OBJECT_SIZE_M distant.CAMERA_M distant.LAMPS_M
        distant.BRIGHT_ALBEDO reflectance_solve.HIGHLIGHT_SHARE
        equivalent_session.EXPOSURE
        colour_albedo.CELL_SHARES sensor_estimate.EMPTY_CURVE sensor_estimate.MAX_EXPOSURE_RATIO
        translucency.MIN_LIGHTS
        cast_shadows.HIDDEN normalised_images.BYTES_PER_VALUE criterion.MIN_LIGHTS
        photometry.OVERDETERMINED
        photometry.REDUNDANT markov_field.UNKNOWN prior_forecast.ALBEDO
        shadow_light.LEAST_SKY_VIEW local_regression.LEAST_WEIGHT
        local_regression.MX local_regression.MY local_regression.MZ local_regression.AX local_regression.AY
        local_regression.AZ local_regression.DX local_regression.DY local_regression.DZ local_regression.OWN
        local_regression.SQUARES local_regression.W local_regression.WA local_regression.WD local_regression.WAA
        local_regression.WAD local_regression.WDD local_regression.X local_regression.Y local_regression.Z
        local_regression.XA local_regression.YA local_regression.ZA local_regression.XD local_regression.YD
        local_regression.ZD""",
    "defaults of what a capture may state itself": """
        image_set.POSITION_SIGMA_M image_set.INTENSITY_SIGMA image_set.FULL_WELL_E image_set.READ_NOISE_E""",
    "of settings": """
        distant.DIRECTION_SIGMA_RAD""",
    "sizes of blocks and samples: more changes time and memory": """
        alternation.MAX_COARSE_PIXELS alternation.SAMPLE_PIXELS alternation.PROBE_PIXELS
        photometry.LOBE_SAMPLES distant.SAMPLE_ROWS
        silhouette.SAMPLE_ROWS light_tests.REGIONS
        reflectance_solve.SAMPLE_PIXELS error_variance.STRIP_ROWS
        error_variance.NEIGHBOUR_ROWS block_solve.INFORMATION_PIXELS pixel_solution.SAMPLE_PIXELS
        integrability.STRIP_ROWS integrability.OVERLAP_ROWS integrability.SAMPLED_CELLS integration.STRIP_ROWS
        interreflection.AZIMUTHS
        interreflection.WALL_AZIMUTHS light_tests.MAX_SWAPPED light_tests.MAX_TEST_PIXELS memory_mapped.LARGE_BYTES
        photon_transfer.INITIAL_SAMPLE pixel_noise.MAX_PRODUCTS
        pixel_solve_kernels.BLOCK_PIXELS poisson.SHARED_FROM_PIXELS
        pyramid.BLOCK_VALUES pyramid.MIN_BLOCK_ROWS
        sensor_estimate.MAX_PIXELS photon_transfer.STRIPS normalised_images.BYTES_PER_EXTRA
        normalised_images.MAX_HELD_BYTES normalised_images.BLOCK_ROWS surface_diffusion.NODES
        stopping_rule.COUNTS optimise.RANDOM_START_LIGHTS design_problem.SAMPLE_PIXELS
        design_problem.MAX_CANDIDATES prior_forecast.SAMPLE_PIXELS
        prior_forecast.SHOWN_LIGHTS prior_forecast.POINTS candidate_lights.DOME_CANDIDATES
        visibility.MAP_SIZE translucency.GRID photon_transfer.BINS
        resampling.EXTRAPOLATION_PX local_regression.RADIUS_PX
        local_regression.STRIP_ROWS local_regression.CHUNK_COLUMNS markov_field.REACH markov_field.SAMPLED_ROWS
        markov_field.STRIP_ROWS""",
    "steps and tolerances of numerical methods": """
        photometry.UNDISTORTION_ROUNDS photometry.UNDISTORTION_STEP reflectance_kernels.DIFFERENCE_STEP
        photon_transfer.CLIP_ITERATIONS
        photon_transfer.IRLS_ITERATIONS poisson.ITERATIONS poisson.TOLERANCE poisson.JACOBI_SHARE
        residual_noise.ROUNDS alternation.EXTRA_ROUNDS alternation.CONVERGED_DEG
        alternation.INITIAL_DISCONTINUITY_ROUNDS alternation.MAX_SHIFT_STEP_M pixel_solution.PRELIMINARY_ITERATIONS
        term_tests.LEAST_SIGNAL term_tests.LEAST_INFORMATION term_tests.TURN_DIFFERENCE_DEG
        interreflection_kernels.LEVELS surface_diffusion.MIN_COEFFICIENT exposure_plan.SWEEPS discontinuity.WEIGHT_FLOOR
        discontinuity.LEAST_START_WEIGHT discontinuity.LEAST_LAMP_M integration.BILATERAL_ROUNDS
        integration.LEAST_BILATERAL_WEIGHT integrability.CONVERGED integrability.ITERATIONS robust_solve.IRLS_ITERATIONS
        relaxation.MAX_GAP relaxation.MAX_ROUNDS
        relaxation.MIN_RELATIVE_WEIGHT optimise.MIN_IMPROVEMENT optimise.MAX_PASSES baselines.AZIMUTH_STEPS
        registration.ROUNDS registration.LEAST_STEP_PX
        translucency.ALBEDO_ROUNDS translucency.ROBUST_ROUNDS term_solve.ROUNDS
        term_solve.METAL_ROUNDS term_solve.HIGHLIGHT_STARTS term_solve.METAL_STARTS
        image_terms.LEAST_ALBEDO image_terms.MAX_GLOSS_STEP term_alternatives.GLOSS_START term_alternatives.METAL_START
        lamp_alternatives.REFINEMENTS lamp_alternatives.REFINED_DEG shadow_light.ROBUST_ROUNDS
        markov_field.SWEEPS markov_field.LARGEST_STEP
        local_regression.ROUNDS local_regression.LEAST_NOISE local_regression.CERTAIN local_regression.RIDGE""",
    "grids of what may be chosen": """
        exposure_plan.SHORTEST exposure_plan.LONGEST exposure_plan.FRAMES exposure_plan.RATIOS
        self_calibration.SIGMA_FACTORS
        translucency.LENGTHS_PX translucency.TESTED_PX model_trial.ROUGH light_tests.TURNS_DEG
        reflectance_fit.DIFFUSE_FORMS reflectance_kernels.GGX_ROUGHNESS""",
    "pictures": """
        explain.IMAGE_PX explain.BRIGHTEST_PERCENTILE explain.OUTSIDE explain.SHOWN_RANGE""",
}
"""Why a number at a module's level is not tuned, and the names of those; modules without their package."""

INLINE = {
    "alternation": 1, "cast_shadows": 2, "discontinuity": 1,
    "distant": 2, "reflectance_fit": 2, "reflectance_kernels": 13, "exposure_plan": 2,
    "grey_tile": 1,
    "integration": 2, "interreflection_kernels": 2, "light_tests": 1, "image_values": 1,
    "photon_transfer": 3, "pixel_solve": 1, "planned_images": 2, "planner": 2, "prior_forecast": 1,
    "sample_pixels": 2, "self_calibration": 1, "silhouette": 7, "translucency": 1, "visibility": 1,
}  # fmt: skip
"""Numbers within functions that are not plain, by module."""


@dataclass(frozen=True)
class Number:
    """A tuned number: module without its package, field, value, unit and the docstring's text."""

    module: str
    name: str
    value: str
    unit: str
    text: str

    @property
    def key(self) -> str:
        """Module and name."""
        return f"{self.module}.{self.name}"

    @property
    def meaning(self) -> str:
        """The docstring's first sentence."""
        return _sentences(self.text)[0]

    @property
    def source(self) -> str:
        """What the docstring says beyond the first sentence: measurement or reason; empty where there is none."""
        return _sentences(self.text)[1]


def _sentences(text: str) -> tuple[str, str]:
    first, dot, rest = text.partition(". ")
    return first + dot.strip(), rest


def paths() -> dict[str, Path]:
    """Files of all modules of solver and planner by their names without package."""
    found = [ACQUISITION / f"{name}.py" for name in ("photometry", "image_values", "cast_shadows")]
    found += [path for package in ("normals", "plan") for path in sorted((ACQUISITION / package).rglob("*.py"))]
    return {path.stem: path for path in found if path.stem != "__init__"}


def _modules() -> Iterator[tuple[str, ast.Module]]:
    """Names without their package, and trees, of all modules of solver and planner; nothing is imported."""
    for name, path in paths().items():
        yield name, ast.parse(path.read_text(encoding="utf-8"))


@cache
def settings() -> tuple[Number, ...]:
    """All tuned numbers, as modules and their order in these have them."""
    numbers: list[Number] = []
    for name, tree in _modules():
        for held in tree.body:
            if isinstance(held, ast.ClassDef) and _is_settings(held):
                numbers += [replace(number, module=name) for number in _numbers(held)]
    return tuple(numbers)


def _numbers(held: ast.ClassDef) -> Iterator[Number]:
    """The fields of a settings class, each with the text below it."""
    for statement, following in zip(held.body, [*held.body[1:], ast.Pass()], strict=True):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.value, ast.Call):
            value, unit = statement.value.args
            stated = isinstance(following, ast.Expr)
            text = " ".join(str(ast.literal_eval(following.value)).split()) if stated else ""
            yield Number("", ast.unparse(statement.target), ast.unparse(value), str(ast.literal_eval(unit)), text)


def constants() -> list[str]:
    """Names at module level whose values have numbers in them, `module.NAME`."""
    found: list[str] = []
    for name, tree in _modules():
        for statement in tree.body:
            if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
                continue
            if any(isinstance(n, ast.Constant) and type(n.value) in {int, float} for n in ast.walk(statement.value)):
                targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                named = [n for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)]
                found += [f"{name}.{one.id}" for one in named]
    return found


def inline() -> dict[str, int]:
    """Numbers within functions that are not plain, counted by module."""
    counts: Counter[str] = Counter()
    for name, tree in _modules():
        for statement in tree.body:
            if isinstance(statement, ast.FunctionDef | ast.ClassDef) and not _is_settings(statement):
                counts[name] += sum(not is_plain(n.value) for n in ast.walk(statement) if isinstance(n, ast.Constant))
    return {name: count for name, count in counts.items() if count}


def _is_settings(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.ClassDef) and "= tuned(" in ast.unparse(statement)


def is_plain(value: object) -> bool:
    """Whether a number within a function needs no reason: whole, a half or quarter, or a guard."""
    if not isinstance(value, float) or value in PLAIN:
        return True
    exponent = math.log10(value)
    return value <= GUARD and abs(exponent - round(exponent)) < 1e-9


def allowed() -> set[str]:
    """Names at module level that are not tuned."""
    return {name for names in REASONS.values() for name in names.split()}


@cache
def set_at_import() -> frozenset[str]:
    """Fields, `module.name`, that a module reads while it is imported (kernels, defaults, derived constants): another
    value in `SETTINGS` does not reach all of their uses."""
    found: set[str] = set()
    names = {name.rpartition(".")[2]: name for name in paths()}
    for name, tree in _modules():
        for node in _outside_functions(tree):
            if not isinstance(node, ast.Attribute):
                continue
            if isinstance(node.value, ast.Name) and node.value.id == "SETTINGS":
                found.add(f"{name}.{node.attr}")
            elif isinstance(node.value, ast.Attribute) and node.value.attr == "SETTINGS":
                owner = ast.unparse(node.value.value).rpartition(".")[2]
                found.add(f"{names[owner]}.{node.attr}")
    return frozenset(found)


def _outside_functions(tree: ast.Module) -> Iterator[ast.AST]:
    """The nodes of a module that are in no body of a function; decorators and defaults are among them."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        body = node.body if isinstance(node, ast.FunctionDef) else [node.body] if isinstance(node, ast.Lambda) else []
        waiting += [child for child in ast.iter_child_nodes(node) if child not in body]


def main() -> None:
    """Prints how many numbers there are of each kind."""
    found = settings()
    print(f"{len(found)} tuned numbers in settings, {sum(bool(one.source) for one in found)} with a source or reason")
    print(f"{sum(inline().values())} numbers in functions")
    for reason, names in REASONS.items():
        print(f"{len(names.split())} constants: {reason}")


if __name__ == "__main__":
    main()
