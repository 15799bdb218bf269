"""The surface of the normals: integrated depth, discontinuities, integrable normals, regression on neighbours."""
