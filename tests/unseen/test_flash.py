"""A flash in one image: the fit of all images is not poor, but without this image it is far better."""

from tests.unseen import with_fault


def test_solve_flash_in_one_image_leaves_it_out() -> None:
    pair = with_fault.solved("sheet", 62, "lambert", "one-flash")
    assert not pair.sound.findings
    assert with_fault.kinds(pair.faulty) == [("bad image", True)]
    assert pair.error_ratio < 1.3
