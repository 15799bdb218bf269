"""The surface that normals belong to: depth, discontinuities, and normals improved by their neighbours.

Three modules improve normals, in this order: `integrability` imposes the constraint of a surface, `local_regression`
reduces the noise of all normals, and `markov_field` regularises those that stay uncertain.
"""
