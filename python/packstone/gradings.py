"""Gradings: the share of the mass of the aggregate that passes each sieve, by tables, standards, curves and laws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

from ._fields import Fields
from .errors import invalid

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

StandardName = Literal[
    "DIN 1045-2",
    "ASTM C33",
    "AASHTO M 43",
    "EN 12620",
    "EN 196-1",
    "IS 383",
    "BS 882",
    "GB/T 14685",
    "AREMA",
]
By = Literal["mass", "number"]

# By how much a share may be larger than the whole, for the rounding of sums.
ROUNDING = 1e-9


class Grading(Fields):
    """The mass fraction of the aggregate that passes each sieve.

    Examples
    --------
    >>> packstone.Grading.standard("57", "ASTM C33", "upper")
    Grading({'type': 'standard', 'standard': 'ASTM C33', 'name': '57', 'curve': 'upper'})
    >>> packstone.Grading.fuller(16)
    Grading({'type': 'fuller', 'd_max_mm': 16, 'exponent': 0.5})
    """

    @classmethod
    def standard(
        cls,
        name: str,
        standard: StandardName | None = None,
        curve: Literal["lower", "middle", "upper"] | None = None,
    ) -> Grading:
        """A grading of a standard: a curve of DIN 1045-2, or one between the limits of a band.

        Parameters
        ----------
        name
            That of the grading in the standard, as ``"A16"`` or, of ``"ASTM C33"``, ``"57"``;
            :meth:`Client.capabilities` lists all.
        standard
            The standard, DIN 1045-2 if it is not given.
        curve
            The curve of a band, the middle if it is not given.
        """
        return cls(type="standard", standard=standard, name=name, curve=curve)

    @classmethod
    def fuller(cls, d_max_mm: float, exponent: float = 0.5) -> Grading:
        """Fuller's curve: a mass fraction (d / d_max)^exponent is finer than d.

        Parameters
        ----------
        d_max_mm
            The largest diameter.
        exponent
            The exponent.
        """
        return cls(type="fuller", d_max_mm=d_max_mm, exponent=exponent)

    @classmethod
    def andreasen(cls, d_min_mm: float, d_max_mm: float, exponent: float) -> Grading:
        """The modified Andreasen curve: (d^q - d_min^q) / (d_max^q - d_min^q) is finer than d.

        Parameters
        ----------
        d_min_mm, d_max_mm
            The smallest and the largest diameter.
        exponent
            The exponent q.
        """
        return cls(type="andreasen", d_min_mm=d_min_mm, d_max_mm=d_max_mm, exponent=exponent)

    @classmethod
    def bolomey(cls, d_max_mm: float, a_percent: float) -> Grading:
        """Bolomey's curve of aggregate and cement together: A + (1 - A) (d / d_max)^0.5 is finer than d.

        Parameters
        ----------
        d_max_mm
            The largest diameter.
        a_percent
            The coefficient A in percent.
        """
        return cls(type="bolomey", d_max_mm=d_max_mm, a_percent=a_percent)

    @classmethod
    def faury(
        cls, d_max_mm: float, a_percent: float, b_percent: float | None = None, mould_radius_mm: float | None = None
    ) -> Grading:
        """Faury's curve of aggregate and cement together.

        Parameters
        ----------
        d_max_mm
            The largest diameter.
        a_percent, b_percent
            The coefficients A and B in percent.
        mould_radius_mm
            The volume of the mould over its area.
        """
        return cls(
            type="faury",
            d_max_mm=d_max_mm,
            a_percent=a_percent,
            b_percent=b_percent,
            mould_radius_mm=mould_radius_mm,
        )

    @classmethod
    def dreux_gorisse(cls, d_max_mm: float, k_percent: float, d_min_mm: float | None = None) -> Grading:
        """The curve of Dreux and Gorisse.

        Parameters
        ----------
        d_max_mm
            The largest diameter.
        k_percent
            The correction K in percent.
        d_min_mm
            The smallest diameter.
        """
        return cls(type="dreux_gorisse", d_min_mm=d_min_mm, d_max_mm=d_max_mm, k_percent=k_percent)

    @classmethod
    def lognormal(
        cls,
        median_mm: float,
        sigma: float,
        *,
        by: By | None = None,
        d_min_mm: float | None = None,
        d_max_mm: float | None = None,
    ) -> Grading:
        """A lognormal law.

        Parameters
        ----------
        median_mm
            The median diameter.
        sigma
            The standard deviation of ln d.
        by
            Whether the shares of the ``mass`` (the default) or of the ``number`` of grains follow the law.
        d_min_mm, d_max_mm
            Bounds: the diameters that 0.1 % and 99.9 % are finer than, if they are not given.
        """
        return cls(type="lognormal", median_mm=median_mm, sigma=sigma, by=by, d_min_mm=d_min_mm, d_max_mm=d_max_mm)

    @classmethod
    def normal(
        cls,
        mean_mm: float,
        standard_deviation_mm: float,
        *,
        by: By | None = None,
        d_min_mm: float | None = None,
        d_max_mm: float | None = None,
    ) -> Grading:
        """A normal law between two bounds.

        Parameters
        ----------
        mean_mm, standard_deviation_mm
            The mean and the standard deviation of the diameter.
        by
            Whether the shares of the ``mass`` (the default) or of the ``number`` of grains follow the law.
        d_min_mm, d_max_mm
            Bounds: the diameters that 0.1 % and 99.9 % are finer than, if they are not given.
        """
        return cls(
            type="normal",
            mean_mm=mean_mm,
            standard_deviation_mm=standard_deviation_mm,
            by=by,
            d_min_mm=d_min_mm,
            d_max_mm=d_max_mm,
        )

    @classmethod
    def weibull(
        cls,
        scale_mm: float,
        shape: float,
        *,
        by: By | None = None,
        d_min_mm: float | None = None,
        d_max_mm: float | None = None,
    ) -> Grading:
        """Weibull's law: 1 - exp(-(d / scale)^shape) is finer than d.

        Parameters
        ----------
        scale_mm, shape
            Its parameters.
        by
            Whether the shares of the ``mass`` (the default) or of the ``number`` of grains follow the law.
        d_min_mm, d_max_mm
            Bounds: the diameters that 0.1 % and 99.9 % are finer than, if they are not given.
        """
        return cls(type="weibull", scale_mm=scale_mm, shape=shape, by=by, d_min_mm=d_min_mm, d_max_mm=d_max_mm)

    @classmethod
    def rosin_rammler(
        cls,
        characteristic_mm: float,
        exponent: float,
        *,
        d_min_mm: float | None = None,
        d_max_mm: float | None = None,
    ) -> Grading:
        """The law of Rosin and Rammler: Weibull's, by mass.

        Parameters
        ----------
        characteristic_mm
            The diameter that 63.2 % of the mass pass.
        exponent
            The exponent.
        d_min_mm, d_max_mm
            Bounds: the diameters that 0.1 % and 99.9 % are finer than, if they are not given.
        """
        return cls(
            type="rosin_rammler",
            characteristic_mm=characteristic_mm,
            exponent=exponent,
            d_min_mm=d_min_mm,
            d_max_mm=d_max_mm,
        )

    @classmethod
    def sizes(cls, sizes: Iterable[Sequence[float]], by: By | None = None) -> Grading:
        """Single sizes.

        Parameters
        ----------
        sizes
            Pairs of the diameter in mm and its share. Shares count by their ratios: numbers of grains are shares, too.
        by
            Whether shares are of the ``mass`` (the default) or of the ``number`` of grains.

        Examples
        --------
        >>> packstone.Grading.sizes([(4, 300), (8, 20)], by="number")["by"]
        'number'
        """
        shares = [{"diameter_mm": float(diameter), "share": float(share)} for diameter, share in sizes]
        return cls(type="sizes", sizes=shares, by=by)

    @classmethod
    def sieves(
        cls,
        points: Sequence[tuple[float, float]] | ArrayLike,
        between: Literal["log", "linear"] | None = None,
        *,
        percent: bool = False,
    ) -> Grading:
        """A curve through sieves.

        Parameters
        ----------
        points
            Pairs of the diameter in mm and the share of the mass that passes it, in any order. Where 90 % or more pass
            the coarsest sieve, the next one of the series is added, with a warning.
        between
            Whether the passing between two sieves is linear in the logarithm of the diameter (``log``, the default), or
            in the diameter (``linear``).
        percent
            Whether passings are in percent: they are fractions from 0 to 1 if it is not given, and are never guessed.

        Raises
        ------
        InvalidRequest
            If passings are not in the unit that `percent` says.

        Examples
        --------
        >>> packstone.Grading.sieves([(4, 0), (8, 60.5), (16, 100)], percent=True)
        Grading({'type': 'sieves', 'points': [[4, 0.0], [8, 0.605], [16, 1.0]]})
        >>> packstone.Grading.sieves([(4, 0), (8, 60.5), (16, 100)])
        Traceback (most recent call last):
        packstone.errors.InvalidRequest: Invalid argument: points: 60.5 passes 8 mm, which is no fraction from 0 to 1: \
pass percent=True
        """
        pairs = _rows("points", points, 2, "the diameter in mm and what passes it")
        meanings = [f"passes {diameter:g} mm" for diameter, _ in pairs]
        passings = _fractions("points", [passing for _, passing in pairs], percent, meanings)
        shared = [[diameter, passing] for (diameter, _), passing in zip(pairs, passings, strict=True)]
        return cls(type="sieves", points=shared, between=between)

    @classmethod
    def classes(cls, classes: Sequence[tuple[float, float, float]] | ArrayLike, *, percent: bool = False) -> Grading:
        """Size classes.

        Parameters
        ----------
        classes
            Triples of the lower and the upper diameter in mm and the share of the mass.
        percent
            Whether the shares are in percent: they are fractions from 0 to 1 if it is not given.

        Examples
        --------
        >>> packstone.Grading.classes([(4, 8, 40), (8, 16, 60)], percent=True)["classes"][0]
        {'d_min_mm': 4, 'd_max_mm': 8, 'mass_fraction': 0.4}
        """
        rows = _rows("classes", classes, 3, "the lower and the upper diameter in mm and the share")
        meanings = [f"is the share of {row[0]:g} to {row[1]:g} mm" for row in rows]
        shares = _fractions("classes", [row[2] for row in rows], percent, meanings)
        names = ("d_min_mm", "d_max_mm", "mass_fraction")
        items = [dict(zip(names, (*row[:2], share), strict=True)) for row, share in zip(rows, shares, strict=True)]
        return cls(type="classes", classes=items)

    @classmethod
    def monodisperse(cls, diameter_mm: float) -> Grading:
        """Equal spheres.

        Parameters
        ----------
        diameter_mm
            Their diameter.
        """
        return cls(type="monodisperse", diameter_mm=diameter_mm)

    @classmethod
    def diameters(cls, diameters_mm: Sequence[float] | ArrayLike) -> Grading:
        """An explicit list of diameters. Its volume is that of the mix.

        Parameters
        ----------
        diameters_mm
            The diameters.
        """
        return cls(type="diameters", diameters_mm=diameters_mm)


def _rows(argument: str, rows: Any, length: int, what: str) -> list[list[Any]]:
    """A table of numbers as lists, each of a length."""
    plain = rows.tolist() if hasattr(rows, "tolist") else rows
    found = [list(row) if isinstance(row, Iterable) else [row] for row in plain]
    for row in found:
        if len(row) != length:
            raise invalid(argument, f"{row} must have {length} numbers: {what}")
    return found


def _fractions(argument: str, shares: list[Any], percent: bool, meanings: list[str]) -> list[Any]:
    """Shares from 0 to 1, of those that a caller gave in this unit or in percent."""
    numbers = [float(share) if isinstance(share, Real) else 0.0 for share in shares]
    for share, meaning in zip(numbers, meanings, strict=True):
        if not percent and share > 1 + ROUNDING:
            raise invalid(argument, f"{share:g} {meaning}, which is no fraction from 0 to 1: pass percent=True")
        if percent and share > 100 + ROUNDING:
            raise invalid(argument, f"{share:g} {meaning}, which is more than 100 percent")
    most = max(numbers, default=0.0)
    if percent and 0 < most <= 1:
        raise invalid("percent", f"the largest of {argument} is {most:g}, which is a fraction: leave percent out")
    return [share / 100 for share in shares] if percent else shares
