"""The workspace of the cameras: the intersection of their solid cones of view (Eq. 1-4, Sect. 3).

`cones` has Eq. 1-3, `intersection` Eq. 4 with the true fields of view beside it, `extent` the
inscribed ball, the bounding box, the volume and the centroid of an intersection.
"""

from .intersection import (
    Polyhedron,
    Workspace,
    intersect,
    is_unbounded,
    mesh_volume,
    surface_mesh,
    view_volume,
)

__all__ = [
    "Polyhedron",
    "Workspace",
    "intersect",
    "is_unbounded",
    "mesh_volume",
    "surface_mesh",
    "view_volume",
]
