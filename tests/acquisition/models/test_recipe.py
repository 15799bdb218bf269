"""Recipes of release 0.1 that name an objective, of which there is one now."""

import pytest
from pydantic import ValidationError

from acquisition.models.recipe import FORMER_OBJECTIVES, Recipe


@pytest.mark.parametrize("name", FORMER_OBJECTIVES)
def test_recipe_of_release_0_1_with_objective_is_read(name: str) -> None:
    assert Recipe.model_validate({"objective": name, "planned_lights": 2}) == Recipe(planned_lights=2)


@pytest.mark.parametrize("name", ["best", 1, None])
def test_recipe_with_objective_that_never_was_is_refused(name: object) -> None:
    with pytest.raises(ValidationError, match="objective"):
        Recipe.model_validate({"objective": name})
