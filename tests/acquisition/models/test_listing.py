"""Sentences name the first few of many items, and count the others."""

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.listing import NAMED, first_few, refused_lights
from acquisition.runner import step_executor


def test_first_few_of_many_items_are_named_and_the_others_counted() -> None:
    assert first_few([]) == ""
    assert first_few([str(number) for number in range(NAMED)]) == "0, 1, 2, 3, 4"
    assert first_few([str(number) for number in range(NAMED + 2)]) == "0, 1, 2, 3, 4, and 2 more"


@pytest.mark.parametrize("count", [1, NAMED, 100])
def test_lights_with_the_numbers_of_the_plan_are_named_shortly(count: int) -> None:
    lights = [{"number": number, "reason": "too-far", "detail": "1.2 m"} for number in range(count)]
    refused = RigError(ErrorCode.WAYPOINTS_UNREACHABLE, "", lights=lights)
    numbers = tuple(range(10, 10 + count))
    told = step_executor._with_plan_numbers(refused, numbers)  # pyright: ignore[reportPrivateUsage]
    assert "light 10: too-far: 1.2 m" in told.detail
    assert len(told.detail) < 300
    assert [light["number"] for light in told.context["lights"]] == list(numbers)
    assert refused_lights(["light 1: too-far"]) == "light 1: too-far"
