"""Builders of requests: dictionaries with typed arguments, for completion and checks in an editor.

Each builder returns a dictionary of the form that :func:`pack` and ``POST /v1/jobs`` take. A plain dictionary does as
well. Bounds are checked by the engine, whose errors name the field, the value and the bound.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

from ._fields import Fields
from .errors import invalid

if TYPE_CHECKING:
    from datetime import datetime

    import numpy as np
    from numpy.typing import ArrayLike
    from typing_extensions import TypedDict

    from .mixes import Mix

    class JobFields(TypedDict, total=False):
        """The fields of a job."""

        name: str | None
        labels: Mapping[str, str]
        seed: int | np.integer[Any]
        priority: int
        threads: int | None
        timeout_s: float | None
        expires_at: str | datetime | None
        max_attempts: int
        shared: bool
        webhook_url: str | None
        specimen: Specimen | Mapping[str, Any] | float | tuple[float, float, float]
        mix: Mix | Mapping[str, Any]
        distance: Distance | Mapping[str, Any] | Literal["none", "maximize"] | float
        method: Method | Mapping[str, Any] | MethodName
        segregation: Segregation | Mapping[str, Any]
        on_limit: Literal["fail", "keep"]
        materials: Mapping[str, Mapping[str, float]]
        postprocess: Sequence[Mapping[str, Any]] | Mapping[str, Any]


MethodName = Literal["auto", "rsa", "growth", "edmd", "monte_carlo"]
Face = Literal["x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "side"]


class Specimen(Fields):
    """The region that is filled: a :class:`Box` or a :class:`Cylinder`."""


class Box(Specimen):
    """A box: a cube of one edge length, or a prism of three.

    Parameters
    ----------
    x_mm
        The edge of a cube in mm, or all three edges as one tuple or array.
    y_mm, z_mm
        The other edges of a prism in mm.
    boundary
        ``walls`` (the default) for rigid walls, as of a mould, or ``periodic``.

    Examples
    --------
    >>> packstone.Box(150) == packstone.Box(150, 150, 150)
    True
    >>> packstone.Box((60, 40, 20), boundary="periodic")
    Box({'type': 'box', 'size_mm': [60, 40, 20], 'boundary': 'periodic'})
    """

    def __init__(
        self,
        x_mm: float | Sequence[float] | ArrayLike,
        y_mm: float | None = None,
        z_mm: float | None = None,
        *,
        boundary: Literal["walls", "periodic"] | None = None,
    ) -> None:
        size: list[Any]
        if isinstance(x_mm, Real):
            if (y_mm is None) != (z_mm is None):
                raise invalid("z_mm" if z_mm is None else "y_mm", "a box has one edge length or three")
            size = [x_mm, x_mm if y_mm is None else y_mm, x_mm if z_mm is None else z_mm]
        else:
            if y_mm is not None or z_mm is not None:
                raise invalid("y_mm" if y_mm is not None else "z_mm", "x_mm has all edges of the box")
            size = list(x_mm) if isinstance(x_mm, Iterable) else [x_mm]
            if len(size) != 3:
                raise invalid("x_mm", f"{len(size)} edge lengths: a box has one or three")
        super().__init__(type="box", size_mm=size, boundary=boundary)


class Cylinder(Specimen):
    """A cylinder that stands on z = 0 with its axis at x = y = diameter / 2.

    Parameters
    ----------
    diameter_mm, height_mm
        Its sizes in mm.

    Examples
    --------
    >>> packstone.Cylinder(100, 200)
    Cylinder({'type': 'cylinder', 'diameter_mm': 100, 'height_mm': 200})
    """

    def __init__(self, diameter_mm: float, height_mm: float) -> None:
        super().__init__(type="cylinder", diameter_mm=diameter_mm, height_mm=height_mm)


class Distance(Fields):
    """The rule for the gap between the surfaces of two grains.

    ``distance=0.5`` is short for ``Distance.constant(0.5)``.

    `wall_gap_mm` is the gap to the walls. Its default is half of what a grain keeps from another of its size.

    Examples
    --------
    >>> packstone.Distance.constant(0.5, wall_gap_mm=1)
    Distance({'type': 'constant', 'gap_mm': 0.5, 'wall_gap_mm': 1})
    """

    @classmethod
    def none(cls, *, wall_gap_mm: float | None = None) -> Distance:
        """Grains may touch."""
        return cls(type="none", wall_gap_mm=wall_gap_mm)

    @classmethod
    def constant(cls, gap_mm: float, *, wall_gap_mm: float | None = None) -> Distance:
        """The same gap for every pair."""
        return cls(type="constant", gap_mm=gap_mm, wall_gap_mm=wall_gap_mm)

    @classmethod
    def proportional(cls, factor: float, *, wall_gap_mm: float | None = None) -> Distance:
        """A gap of `factor` times the mean diameter of the pair."""
        return cls(type="proportional", factor=factor, wall_gap_mm=wall_gap_mm)

    @classmethod
    def smaller_diameter(cls, factor: float, *, wall_gap_mm: float | None = None) -> Distance:
        """A gap of `factor` times the smaller diameter of the pair."""
        return cls(type="smaller_diameter", factor=factor, wall_gap_mm=wall_gap_mm)

    @classmethod
    def maximize(cls, *, wall_gap_mm: float | None = None) -> Distance:
        """The largest gap, the same for every pair, that can be reached."""
        return cls(type="maximize", wall_gap_mm=wall_gap_mm)


class Method(Fields):
    """The method that computes the packing; ``method="rsa"`` is short for ``Method.rsa()``.

    Examples
    --------
    >>> packstone.Method.edmd(events=1000, growth_rate=0.1)
    Method({'type': 'edmd', 'growth_rate': 0.1, 'stop': {'events': 1000}})
    """

    @classmethod
    def auto(cls) -> Method:
        """Random sequential addition if it will almost surely succeed.

        Otherwise :meth:`growth`.
        """
        return cls(type="auto")

    @classmethod
    def rsa(cls, *, attempts_per_grain: int | None = None) -> Method:
        """Random sequential addition.

        Grains that are not spheres end it after 20 000 000 draws, also where it is not proven that no position is left.

        Parameters
        ----------
        attempts_per_grain
            The number of attempts for each grain. Without it the search is exhaustive.
        """
        return cls(type="rsa", attempts_per_grain=attempts_per_grain)

    @classmethod
    def growth(
        cls, *, time_s: float | None = None, initial_scale: float | None = None, swap: bool | None = None
    ) -> Method:
        """Growing grains: spheres as by :meth:`edmd`, other grains, and spheres among them, as by :meth:`monte_carlo`.

        Parameters
        ----------
        time_s
            The time of packing after which it stops.
        initial_scale
            The share of the final sizes with which growth starts.
        swap
            Whether grains of similar size swap their positions now and then, by which far denser packings are reached.

        Examples
        --------
        >>> packstone.Method.growth(time_s=60)
        Method({'type': 'growth', 'stop': {'time_s': 60}})
        """
        stop = dict(Fields(time_s=time_s)) or None
        return cls(type="growth", initial_scale=initial_scale, swap=swap, stop=stop)

    @classmethod
    def edmd(
        cls,
        *,
        time_s: float | None = None,
        events: int | None = None,
        stall_dt_s: float | None = None,
        initial_scale: float | None = None,
        growth_rate: float | None = None,
        initial_velocity: float | None = None,
        equal_mass: bool | None = None,
        swap: bool | None = None,
    ) -> Method:
        """Event-driven molecular dynamics with growing spheres.

        Parameters
        ----------
        time_s, events
            The time of packing and the number of events after which it stops.
        stall_dt_s
            It stops where the simulated time per event and grain falls below this.
        initial_scale
            The share of the final diameters with which growth starts.
        growth_rate
            The relative growth rate of the diameters while the pressure is low, per s.
        initial_velocity
            The bound of the components of the velocity of the smallest grain at the beginning, in mm/s.
        equal_mass
            Whether all grains have the same mass.
        swap
            Whether grains of similar size swap their positions now and then, by which far denser packings are reached.
        """
        stop = Fields(time_s=time_s, events=events, stall_dt_s=stall_dt_s)
        return cls(
            type="edmd",
            initial_scale=initial_scale,
            growth_rate=growth_rate,
            initial_velocity=initial_velocity,
            equal_mass=equal_mass,
            swap=swap,
            stop=dict(stop) or None,
        )

    @classmethod
    def monte_carlo(
        cls,
        *,
        time_s: float | None = None,
        sweeps: int | None = None,
        initial_scale: float | None = None,
        swap: bool | None = None,
    ) -> Method:
        """Hard-particle Monte Carlo with growing grains of any shape; :meth:`edmd` packs spheres faster.

        Parameters
        ----------
        time_s, sweeps
            The time of packing and the number of sweeps after which it stops.
        initial_scale
            The share of the final sizes with which growth starts.
        swap
            Whether grains of similar size swap their positions now and then, by which far denser packings are reached.
        """
        stop = dict(Fields(time_s=time_s, sweeps=sweeps)) or None
        return cls(type="monte_carlo", initial_scale=initial_scale, swap=swap, stop=stop)


class Segregation(Fields):
    """A gradient of the grain sizes in the specimen.

    Examples
    --------
    >>> packstone.Segregation.along("z", 0.5, direction="up")
    Segregation({'type': 'gradient', 'field': {'type': 'linear', 'axis': 'z', 'direction': 'up'}, 'strength': 0.5})
    """

    @classmethod
    def none(cls) -> Segregation:
        """No gradient."""
        return cls(type="none")

    @classmethod
    def along(
        cls, axis: Literal["x", "y", "z"], strength: float, *, direction: Literal["up", "down"] | None = None
    ) -> Segregation:
        """Coarse grains gather at one end of an axis.

        Parameters
        ----------
        axis
            The axis.
        strength
            How strong the gradient is.
        direction
            The end at which they gather: ``down`` (the default), as they sink, at 0, or ``up``.
        """
        field = Fields(type="linear", axis=axis, direction=direction)
        return cls(type="gradient", field=dict(field), strength=strength)

    @classmethod
    def at_face(cls, face: Face, strength: float) -> Segregation:
        """Coarse grains gather at a face of the specimen."""
        return cls(type="gradient", field={"type": "face", "face": face}, strength=strength)
