"""The MJCF files that come with the project."""

from __future__ import annotations

from pathlib import Path

from invtrack.errors import PlantError


def model_path(name: str) -> Path:
    """The path of the shipped model `models/<name>.xml`.

    An installed wheel carries the models inside the package; an editable checkout has them in `models/` beside it.

    Raises PlantError, with the available names, where there is no such model.
    """
    package = Path(__file__).resolve().parents[1]
    folders = [folder for folder in (package / "models", package.parent / "models") if folder.is_dir()]
    available = {path.stem: path for folder in reversed(folders) for path in folder.glob("*.xml")}
    if name not in available:
        raise PlantError(
            f"no shipped model is named {name!r}; there are: {', '.join(sorted(available)) or 'none'}."
            " Give Plant.from_xml the path of your own MJCF file instead"
        )
    return available[name]
