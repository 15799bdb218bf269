"""The surface that normals belong to: depth by integration, discontinuities, and what neighbours know of a normal.

`integrability`, then `local_regression`, then `markov_field`: a surface's constraint, the noise of all normals, and the
normals that stay uncertain.
"""
