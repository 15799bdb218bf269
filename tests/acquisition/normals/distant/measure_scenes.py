"""Errors under distant lights over rendered scenes: `python -m tests.acquisition.normals.distant.measure_scenes SET`.

Sets: a number of lights, sixteen scenes of `few_light_scenes` each, of 64 px; `--uneven 0.2` scatters the lamps' log
intensities; `gloss`, the eighteen scenes of 96 lights of `gloss_scenes`. A pixel without a normal errs by 90°.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from acquisition.normals import distant
from tests.acquisition.normals.distant import few_light_scenes, gloss_scenes

Scene = few_light_scenes.Scene | gloss_scenes.Scene


def scenes(name: str, seed: int, uneven: float) -> Iterator[tuple[str, Scene]]:
    """The scenes of a set by name, rendered one by one."""
    if name == "gloss":
        for shape in ("ball", "figure-side", "vase-side"):
            for material in gloss_scenes.REFLECTANCES:
                yield f"{shape} {material}", gloss_scenes.scene(shape, material, 64, seed + 10, bounces=24)
        return
    for material in few_light_scenes.MATERIALS:
        for shape in few_light_scenes.SHAPES:
            scene = few_light_scenes.scene(shape, material, int(name), seed, size=64)
            factors = np.exp(np.random.default_rng(seed + 1).normal(0, uneven, len(scene.images)))
            scene = replace(scene, images=scene.images * factors[:, None, None], intensities=factors)
            yield f"{shape} {material}", scene


def main() -> None:
    """Prints the mean error and σ of each scene, and the mean over scenes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", metavar="SET")
    parser.add_argument("--uneven", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    errors: list[float] = []
    for name, scene in scenes(given.name, given.seed, given.uneven):
        solved = distant.solve(scene.image_set())
        error = scene.errors_deg(np.where(solved.mask[..., None], solved.normals, 0))
        errors.append(float(error.mean()))
        found = ", ".join(finding.kind for finding in solved.findings) + "; " + str(solved.notes.get("why", ""))
        print(f"{name:22} {errors[-1]:6.2f}°  σ {np.nanmean(solved.sigma_deg[solved.mask]):5.2f}°  {found}", flush=True)
    print(f"mean {np.mean(errors):.3f}°")


if __name__ == "__main__":
    main()
