"""The options of exports, as ``openapi.yaml`` defines them.

An option that is a word of Python has an underscore behind it: ``for_``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, TypedDict

from .errors import invalid, near

ExportType = Literal["mesh", "voxels", "slice", "deck", "ldpm", "certificates", "shapes", "quality", "properties"]
MeshFormat = Literal["msh", "geo", "stl", "inp", "vtu", "med"]
VoxelFormat = Literal["vti", "raw", "inp", "npy", "vtk", "zip"]
SliceFormat = Literal["svg", "png", "json", "geo", "msh", "inp", "vtu"]
DeckFormat = Literal["zip"]
LdpmFormat = Literal["chrono", "tets", "facets", "cells"]
CertificateFormat = Literal["csv", "json"]
ShapeFormat = Literal["csv", "json"]
QualityFormat = Literal["json"]
PropertyFormat = Literal["json", "vti"]
Axis = Literal["x", "y", "z"]
Materials = Mapping[str, Mapping[str, float]]


class SurfaceOptions(TypedDict, total=False):
    """Options of the surfaces of a mesh."""

    segments: int
    size_mm: float
    min_size_mm: float
    max_size_mm: float
    size_field: bool
    max_segments: int
    volume_correction: Literal["none", "scaled"]
    faces: Literal["simplified", "exact"]
    max_bytes: int


class TetrahedronOptions(SurfaceOptions, total=False):
    """Options of the surfaces and the tetrahedra of a mesh."""

    order: int
    tet_size_mm: float
    tet_size_matrix_mm: float
    target_elements: int
    tet_growth: float


class MeshOptions(TetrahedronOptions, total=False):
    """Options of the export ``mesh``."""

    elements: Literal["triangles", "tetrahedra"]


class VoxelOptions(TypedDict, total=False):
    """Options of the export ``voxels``."""

    for_: Literal["damask", "amitex", "fans", "automesh"]
    cells: int
    voxel_mm: float
    label: Literal["phase", "grain", "aggregate"]
    fractions: bool
    samples: int
    materials: Materials


class SliceOptions(TypedDict, total=False):
    """Options of the export ``slice``."""

    axis: Axis
    at_mm: float
    pixels: int
    elements: Literal["triangles"]
    order: int
    plane: Literal["stress", "strain"]
    segments: int
    max_size_mm: float


class DeckOptions(TetrahedronOptions, total=False):
    """Options of the export ``deck``."""

    solver: Literal["calculix", "abaqus"]
    load: Literal["uniaxial_x", "uniaxial_y", "uniaxial_z", "shear_xy", "shear_xz", "shear_yz", "temperature"]
    strain: float
    temperature_change_k: float
    materials: Materials
    axis: Axis
    at_mm: float
    elements: Literal["voxels", "tetrahedra", "triangles"]
    plane: Literal["stress", "strain"]
    cells: int
    voxel_mm: float


class LdpmOptions(TypedDict, total=False):
    """Options of the export ``ldpm``."""

    spacing: float
    fictitious_diameter: float
    boundary_nodes: Literal["poisson_disk", "random"]
    seed: int
    surface_radius: float


class CertificateOptions(TypedDict, total=False):
    """Options of the export ``certificates``."""

    closer_than_mm: float


class NoOptions(TypedDict, total=False):
    """Options of the exports ``shapes`` and ``quality``."""


class PropertyOptions(TypedDict, total=False):
    """Options of the export ``properties``."""

    cells: int
    kinds: str
    scheme: Literal["rotated", "hexahedra"]
    cut_voxels: Literal["mixed", "labels"]
    tolerance: float
    walls: Literal["periodic", "mirrored"]
    fields: bool
    materials: Materials


class FileOptions(TetrahedronOptions, total=False):
    """Options of the exports that a suffix names: ``mesh``, ``voxels`` and ``slice``."""

    elements: Literal["triangles", "tetrahedra"]
    for_: Literal["damask", "amitex", "fans", "automesh"]
    cells: int
    voxel_mm: float
    label: Literal["phase", "grain", "aggregate"]
    fractions: bool
    samples: int
    materials: Materials
    axis: Axis
    at_mm: float
    pixels: int
    plane: Literal["stress", "strain"]


OPTIONS: Mapping[ExportType, type] = {
    "mesh": MeshOptions,
    "voxels": VoxelOptions,
    "slice": SliceOptions,
    "deck": DeckOptions,
    "ldpm": LdpmOptions,
    "certificates": CertificateOptions,
    "shapes": NoOptions,
    "quality": NoOptions,
    "properties": PropertyOptions,
}


def check_options(type: str, options: Mapping[str, Any]) -> None:
    """Raises an :class:`InvalidRequest` for an option that an export does not have, with the name that is near to it.

    An unknown type is left to the engine.
    """
    found = OPTIONS.get(type)  # type: ignore[call-overload]
    if found is None:
        return
    known = {name.removesuffix("_") for name in found.__annotations__}
    for name in options:
        if name.removesuffix("_") not in known:
            has = ", ".join(found.__annotations__) or "no options"
            raise invalid(name, f"unknown option: {type} has {has}{near(name, known)}")
