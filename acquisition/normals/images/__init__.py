"""Images to solve, of sessions and folders, normalised by the lamps' intensities, and the object's mask.

`session_images` and `acquisition.normals.near_light` make the type that solvers read, `normalised_images.Images`.
"""
