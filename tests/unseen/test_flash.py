"""A flash in one image: its intensity tells, though the images together do not fit badly, and scaling is no cure."""

from tests.unseen import with_fault


def test_solve_flash_in_one_image_leaves_it_out() -> None:
    pair = with_fault.solved("sheet", 62, "lambert", "one-flash")
    assert not pair.sound.findings
    assert with_fault.kinds(pair.faulty) == [("intensities", True), ("bad image", True)]
    assert pair.error_ratio < 1.3
