"""Images to solve: what session and folders give, normalised by the lamps' intensities, and the object's mask.

`session_images` and `acquisition.formats.folders` make the one type that solvers read, `normalised_images.Images`.
"""
