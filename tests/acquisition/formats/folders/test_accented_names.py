"""Lists name images whose file names other systems spell otherwise."""

import unicodedata
from pathlib import Path

import pytest

from acquisition.formats import folders
from tests.acquisition.formats.folders import small


@pytest.mark.parametrize("forms", [("NFC", "NFD"), ("NFD", "NFC")])
def test_read_image_list_of_accented_names_finds_its_images(forms: tuple[str, str], tmp_path: Path) -> None:
    """macOS stores an ä as a letter and its dots, also in archives; the list may have it as one character."""
    listed, stored = (unicodedata.normalize(form, "Gefäß") for form in forms)
    folder = small.lp(tmp_path / "in")
    for path in folder.glob("img *.png"):
        path.rename(folder / path.name.replace("img", stored))
    lights = folder / "lights.lp"
    lights.write_text(lights.read_text().replace("img", listed), encoding="utf-8")
    assert folders.read(folder, tmp_path).count == 6
