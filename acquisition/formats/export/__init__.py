"""Export of a normal map: a result's own folder, which reads back exactly, and the formats of other programs.

Pictures are for people and for normal-integration tools: normals as (n + 1)/2 in 16 bits (8 bits would cost 0.17°),
OpenGL green (+Y up) unless the name says DirectX. Each file carries its convention in its own metadata.
"""

from acquisition.formats.atomic_write import atomic_folder
from acquisition.formats.export.catalogue import FILES, FOLDERS, Source, make
from acquisition.formats.export.map_files import depth_unit
from acquisition.formats.export.result_folder import ARCHIVE, lights_used, read, write, write_into, write_maps
from acquisition.formats.own_files import checksums, refuse_foreign

__all__ = [
    "ARCHIVE",
    "FILES",
    "FOLDERS",
    "Source",
    "atomic_folder",
    "checksums",
    "depth_unit",
    "lights_used",
    "make",
    "read",
    "refuse_foreign",
    "write",
    "write_into",
    "write_maps",
]  # fmt: skip
