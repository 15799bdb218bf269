"""A session of kind response on the simulated cell: interrupted, resumed, and graded against the simulated sensor."""

from collections.abc import Generator

import pytest

from acquisition.models import cell_config
from acquisition.models.calibration_recipe import ResponseRecipe
from acquisition.models.calibration_result import ResponseResult
from acquisition.models.errors import ErrorCode
from acquisition.runner import estimates
from acquisition.session_state import ENDED, State, Trigger
from tests.acquisition.runner.simulated_rig import (
    Rig,
    acknowledge,
    after_first_image,
    end_what_is_left,
    new,
    reason_of,
    simulated_rig,
    wait_for,
)

pytestmark = pytest.mark.long
RECIPE = ResponseRecipe(kind="response", max_images=25)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    with simulated_rig(tmp_path_factory.mktemp("response"), "127.0.6.19", profile="direct") as made:
        yield made


@pytest.fixture(autouse=True)
def _at_ease(rig: Rig) -> None:
    end_what_is_left(rig)


def test_response_session_resumes_and_finds_the_sensor(rig: Rig) -> None:
    session_id = after_first_image(rig, RECIPE, within_s=400)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    acknowledge(rig)
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=500) is State.COMPLETED, reason_of(rig, session_id)

    shots = [shot for shot in rig.store.journal.shots(session_id) if shot.kind == "light"]
    lit = sorted(shot.exposure_s for shot in shots if shot.lamp_on)
    assert len(shots) == 25
    assert sorted(shot.exposure_s for shot in shots if not shot.lamp_on) == [one for one in lit if lit.count(one) > 1]

    entry = estimates.newest(rig.store, session_id)
    assert entry is not None
    folder = (rig.store.folder(session_id) / entry.path).parent
    found = ResponseResult.model_validate_json((folder / "response.json").read_bytes())
    true = cell_config.load_calibration(rig.store.folder(session_id) / "calibration.json").sensor
    for number, (value, truth) in enumerate(
        (
            (found.black_level_dn, true.black_level_dn),
            (found.gain_e_per_dn, true.gain_e_per_dn),
            (found.read_noise_e, true.read_noise_e),
        )
    ):
        assert abs(value - truth) < 4 * found.covariance[number][number] ** 0.5
    assert rig.store.calibrations.calibration(session_id).sensor.gain_e_per_dn == found.gain_e_per_dn
    assert rig.runner.choices.calibration_id == "cell"


def test_response_session_without_lamp_pauses_and_names_it(rig: Rig) -> None:
    rig.control.fault("lamp", fraction=0.0)
    session_id = new(rig, RECIPE)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.PAUSED, *ENDED, within_s=200)
    assert reason_of(rig, session_id)["code"] == ErrorCode.CAPTURE_FRAME_REJECTED
    assert session_id not in [one.id for one in rig.store.calibrations.all()]
