"""`lightpose study`: the benefit of planned lights, measured in simulation without an arm.

`scene_geometry` and `simulated_scene` simulate sessions, graded where a pixel shows one surface. The study has three
parts: `error_curves` (error against the number of images), `paper_criterion` (the paper's figure 9 and its errata) and
`three_images` (the paper's table). `run` executes them in two processes, `study_result` holds the measurements, `page`
and `chart` show them.
"""
