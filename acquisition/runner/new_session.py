"""Creation of a session: its folder first, then its row, so that no session exists that could never start."""

import shutil
import time

from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.cell_config import CellConfig
from acquisition.runner import preconditions
from acquisition.runner.rig_choices import RigChoices
from acquisition.store import SessionRow, Store
from acquisition.store.folder import refusals, write_value
from acquisition.store.session_table import new_session_id


def create(
    store: Store, cell: CellConfig, choices: RigChoices, recipe: AnyRecipe, idempotency_key: str | None
) -> tuple[SessionRow, bool]:
    """Creates a session with its folder; the flag is False when the idempotency key names an existing session.

    The folder has recipe, cell file and calibration, and is complete without the database. Raises RigError
    request.invalid for exposures that the camera cannot make and for a key that was used for another recipe;
    calibration.infeasible if calibration or cell lack what the recipe goes on from; store.disk_full and
    store.unwritable, which leave nothing behind.
    """
    preconditions.require_exposures(recipe, cell)
    known = store.journal.session_of_key(idempotency_key, recipe)
    if known is not None:
        return known, False
    preconditions.require_stated(recipe, cell, choices)
    identity, new = new_session_id(time.time()), False
    folder = store.session_path(identity)
    try:
        with refusals(store.data):
            write_value(folder / "recipe.json", recipe)
            write_value(folder / "cell.json", cell)
            write_value(folder / "calibration.json", choices.calibration)
        row, new = store.journal.create_session(
            recipe, cell.model_dump_json(), cell.fingerprint, idempotency_key, identity
        )
    finally:
        if not new:  # the disk is full, or another request with the same key was first
            shutil.rmtree(folder, ignore_errors=True)
    return row, new
