"""Finding the shipped models."""

from __future__ import annotations

import mujoco
import pytest

from invtrack.errors import PlantError
from invtrack.plant.loading import model_path


def test_shipped_model_is_found_and_compiles() -> None:
    path = model_path("cantilever")
    assert path.is_absolute()
    assert mujoco.MjSpec.from_file(str(path)).modelname == "cantilever"


@pytest.mark.parametrize("name", ["cantilver", "cantilever.xml", "../models/cantilever", ""])
def test_unknown_name_is_answered_with_the_available_ones(name: str) -> None:
    with pytest.raises(PlantError, match=r"no shipped model is named .*there are: .*cantilever"):
        model_path(name)
