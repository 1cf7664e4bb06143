"""The shapes of grains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from ._fields import Fields

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class Ratios(Fields):
    """How the ratios of the axes ``a >= b >= c`` of grains are distributed.

    The elongation is b/a, the flatness c/b, both 0.1 to 1. A law of one ratio is a number, or a mapping as
    ``{"type": "uniform", "min": 0.5, "max": 0.9}``.

    Examples
    --------
    >>> packstone.Ratios.constant(0.8, 0.6)
    Ratios({'type': 'constant', 'elongation': 0.8, 'flatness': 0.6})
    """

    @classmethod
    def constant(cls, elongation: float, flatness: float) -> Ratios:
        """The same for all grains."""
        return cls(type="constant", elongation=elongation, flatness=flatness)

    @classmethod
    def independent(
        cls, elongation: float | Mapping[str, Any], flatness: float | Mapping[str, Any]
    ) -> Ratios:
        """Elongation and flatness independent of one another."""
        return cls(type="independent", elongation=elongation, flatness=flatness)

    @classmethod
    def triangle(cls, k: float) -> Ratios:
        """Uniform over ``k <= c/a <= b/a <= 1``."""
        return cls(type="triangle", k=k)

    @classmethod
    def measured(
        cls, axes: Sequence[tuple[float, float, float]] | ArrayLike, weights: Sequence[float] | None = None
    ) -> Ratios:
        """Those of grains that were measured: triples of axes in any unit."""
        return cls(type="measured", axes=axes, weights=weights)

    @classmethod
    def flakiness(cls, index: float, elongation: float | Mapping[str, Any] | None = None) -> Ratios:
        """Grains with this flakiness index of EN 933-3, 0 to 1."""
        return cls(type="flakiness", index=index, elongation=elongation)

    @classmethod
    def shape_index(cls, index: float, elongation: float | Mapping[str, Any] | None = None) -> Ratios:
        """Grains with this shape index of EN 933-4, 0 to 1."""
        return cls(type="shape_index", index=index, elongation=elongation)


class Shape(Fields):
    """The shape of grains.

    Examples
    --------
    >>> shape = packstone.Shape.ellipsoid(packstone.Ratios.constant(0.8, 0.6))
    >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4, shape=shape), seed=1)
    >>> (packing.semi_axes[0] / packing.semi_axes[0, 0]).round(2).tolist()
    [1.0, 0.8, 0.48]
    """

    @classmethod
    def sphere(cls) -> Shape:
        """Spheres."""
        return cls(type="sphere")

    @classmethod
    def ellipsoid(cls, ratios: Ratios | Mapping[str, Any]) -> Shape:
        """Ellipsoids with these ratios of axes."""
        return cls(type="ellipsoid", ratios=ratios)

    @classmethod
    def polyhedron(
        cls,
        template: Literal[
            "cuts",
            "deformed_cuboid",
            "voronoi",
            "tetrahedron",
            "cube",
            "octahedron",
            "dodecahedron",
            "icosahedron",
        ]
        | None = None,
        *,
        faces: int | None = None,
        displacement: float | None = None,
        ratios: Ratios | Mapping[str, Any] | None = None,
        rounding: float | None = None,
        template_count: int | None = None,
        template_seed: int | None = None,
    ) -> Shape:
        """Angular grains: convex polyhedra, each of them one of several templates in its own size.

        Parameters
        ----------
        template
            How a template is made, or a Platonic solid.
        faces
            The number of ``cuts``.
        displacement
            How far the corners of a ``deformed_cuboid`` are moved, as a share of its edge.
        ratios
            The ratios of the axes by which templates are stretched.
        rounding
            The radius of rounding over the equivalent diameter.
        template_count
            The number of templates; of a Platonic solid 1 if it is not given.
        template_seed
            The seed of the templates, which do not depend on the seed of the job.

        Examples
        --------
        >>> packstone.Shape.polyhedron("cube", rounding=0.05)
        Shape({'type': 'polyhedron', 'template': 'cube', 'rounding': 0.05})
        """
        return cls(
            type="polyhedron",
            template=template,
            faces=faces,
            displacement=displacement,
            ratios=ratios,
            rounding=rounding,
            template_count=template_count,
            template_seed=template_seed,
        )

    @classmethod
    def preset(cls, name: str) -> Shape:
        """A shape by its name, of those that the service lists as ``shape_presets`` in its capabilities."""
        return cls(type="preset", name=name)

    @classmethod
    def mixture(cls, parts: Sequence[tuple[float, Shape]]) -> Shape:
        """Grains of several shapes: pairs of the share of the volume and the shape."""
        return cls(type="mixture", of=[{"share": share, "shape": shape} for share, shape in parts])
