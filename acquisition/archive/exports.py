"""Exports of archived sessions: the session's own folder, a BagIt bag with RO-Crate metadata, a folder for Relight.

Their maintainers' libraries write the formats: `bagit` (RFC 8493, Library of Congress) and `rocrate` (RO-Crate 1.1).
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import bagit
import numpy as np
from rocrate.rocrate import ROCrate

from acquisition import mosaic
from acquisition.archive.archive import Archive
from acquisition.archive.entries import ResultEntry, SessionEntry
from acquisition.formats import export
from acquisition.formats.atomic_write import atomic_folder, refused_if_unwritable
from acquisition.formats.export import light_files, map_files
from acquisition.formats.folders import session_folder
from acquisition.formats.session_files import refuse_in_session
from acquisition.models.base import Float32Array
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.normals.images import colour_albedo

Form = Literal["folder", "bagit", "relight"]
_TYPES = {".tiff": "image/tiff", ".png": "image/png", ".json": "application/json", ".html": "text/html"}


def write(archive: Archive, key: str, form: Form, out: Path) -> None:
    """Writes one session with all its results into a new folder; it appears as a whole or not at all.

    `folder` is a folder as `lightpose solve` reads it, `bagit` the same as a bag's payload with RO-Crate metadata, and
    `relight` the images with 8 bits and their lights. Raises RigError folder.invalid when `out` exists or cannot be
    written, store.disk_full, archive.damaged, archive.not_found.
    """
    if out.exists() or out.is_symlink():
        raise RigError(ErrorCode.FOLDER_INVALID, f"{out} already exists: name a new folder", file=str(out))
    refuse_in_session(out, "--out")
    entry, results = archive.session(key), archive.results(key)
    with refused_if_unwritable(out), atomic_folder(out) as partial:
        if form == "relight":
            _relight(archive, entry, results, partial)
            return
        payload = partial / "data" if form == "bagit" else partial
        for files in (entry.files, *(result.files for result in results)):
            archive.fetch(files, payload)
        if form == "bagit":
            _crate(entry, results, payload)
            for path in payload.iterdir():
                path.rename(partial / path.name)
            payload.rmdir()
            bagit.make_bag(str(partial), _bag_info(entry), checksums=["sha256"])


def _crate(entry: SessionEntry, results: list[ResultEntry], folder: Path) -> None:
    """Writes `ro-crate-metadata.json` over the files of a folder."""
    facts = entry.facts
    crate = ROCrate()
    crate.name = facts.object or facts.session_id
    crate.description = (
        f"Photometric stereo of {facts.object or 'an object'}: {facts.lights} images of {facts.width} × {facts.height} "
        f"pixels under known lights, {len(results)} normal maps. {facts.notes}"
    ).strip()
    if facts.captured_at is not None:
        crate.datePublished = datetime.fromtimestamp(facts.captured_at, UTC)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            name = path.relative_to(folder).as_posix()
            crate.add_file(
                path, name, properties={"encodingFormat": _TYPES.get(path.suffix, "application/octet-stream")}
            )
    made: dict[str, list[str]] = {}
    for result in results:
        made.setdefault(result.solver, []).extend(result.files)
    for solver, names in made.items():
        software = {"@type": "SoftwareApplication", "name": "lightpose", "version": solver}
        crate.add_jsonld({"@id": f"#lightpose-{solver}", **software})
        crate.add_jsonld({
            "@id": f"#solve-{solver}",
            "@type": "CreateAction",
            "name": "Normals by photometric stereo",
            "instrument": {"@id": f"#lightpose-{solver}"},
            "result": [{"@id": name} for name in sorted(names)],
        })  # fmt: skip
    crate.metadata.write(str(folder))


def _bag_info(entry: SessionEntry) -> dict[str, str]:
    facts = entry.facts
    return {
        "External-Identifier": facts.session_id,
        "External-Description": facts.object,
        "Internal-Sender-Identifier": entry.key,
        "Bag-Software-Agent": f"lightpose {facts.software}",
    }


def _relight(archive: Archive, entry: SessionEntry, results: list[ResultEntry], out: Path) -> None:
    """Writes images as PNG with 8 bits, less their lamp-off frames, with `lights.lp` and `lights.dome`.

    Those of a mosaic sensor are interpolated to RGB.
    """
    if entry.facts.kind != "capture":
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"Session {entry.facts.session_id} is of kind {entry.facts.kind}: relight needs a capture",
        )
    if not results:
        raise RigError(
            ErrorCode.ARCHIVE_NOT_FOUND,
            f"Session {entry.facts.session_id} has no result, whose mask is needed: solve it first",
        )
    scratch = out / ".session"
    chosen = max(
        results, key=lambda result: (result.identity.last_pass is None, result.age)
    )  # of all images, if any is
    archive.fetch(entry.files, scratch)
    archive.fetch(chosen.files, scratch)
    capture = session_folder.read(scratch)
    normal_map = export.read(next(scratch.glob(str(Path(next(iter(chosen.files))).parent))))
    last = chosen.identity.last_pass
    observations = capture.observations(max(shot.key.pass_number for shot in capture.shots) if last is None else last)
    images = session_folder.images(observations, capture.calibration, normal_map.silhouette)
    source = export.Source(normal_map, images)
    names = tuple(f"{number:03d}.png" for number in range(1, images.count + 1))
    for number, name in enumerate(names):
        pixels = np.asarray(images.rows(number, 0, images.height), np.float32) / np.float32(images.full_scale)
        map_files.png(out / name, _picture(pixels, capture.calibration))
    light_files.write_lp(out / "lights.lp", names, source.directions)
    export.make("lights.dome", source, out)
    for path in sorted(scratch.rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()
    scratch.rmdir()


def _picture(pixels: Float32Array, calibration: Calibration) -> np.ndarray:
    """An image of 8 bits, linear, of a frame (H, W) from 0 to 1: grey, or RGB of a mosaic sensor's sites."""
    channel = mosaic.of_calibration(calibration, slice(0, pixels.shape[0]), slice(0, pixels.shape[1]))
    if channel is not None:
        balanced = pixels / mosaic.white(calibration)[channel]
        channels = mosaic.interpolated(balanced, channel, np.ones(pixels.shape, np.bool_))
        pixels = colour_albedo.in_srgb(channels, calibration)
    return np.round(255 * np.clip(pixels, 0, 1)).astype(np.uint8)
