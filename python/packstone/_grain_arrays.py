"""The grains of a packing as arrays."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from ._numpy import np
from ._optional import needed
from ._sources import File, Source

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import DTypeLike, NDArray
    from scipy.spatial.transform import Rotation


class Grain(NamedTuple):
    """A grain of a packing. Lengths are in mm."""

    position: NDArray[np.float64]
    """The centre: x, y, z."""
    diameter: float
    """The diameter; of other shapes that of the sphere of equal volume."""
    sieve_size: float
    """The smallest square sieve opening that the grain passes."""
    aggregate: int
    """The index of its aggregate, from 0."""
    template: int
    """The index of the template of a polyhedron, from 0; -1 of other grains."""


class GrainArrays:
    """The arrays of a :class:`Packing`, largest grain first. They cannot be written: change a ``copy()``."""

    def __init__(self, source: Source) -> None:
        self._source = source

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns of :attr:`grains`."""
        return self._source.columns()

    @cached_property
    def grains(self) -> NDArray[np.float64]:
        """The grains, largest first: an N x 4 array of the centre x, y, z and the diameter, in mm.

        :attr:`columns` names the columns. Grains that are not spheres have the sieve size, a quaternion, and the
        semi-axes of ellipsoids or the template of polyhedra, too. Of a mix of several aggregates the last column is
        their index from 0. ``numpy.asarray(packing)`` is this array. Arrays that are a part of it share its memory, and
        none can be written: change a ``copy()``.
        """
        grains = self._source.grains()
        grains.setflags(write=False)
        return grains

    @property
    def positions(self) -> NDArray[np.float64]:
        """The centres of the grains: an N x 3 array in mm."""
        return self.grains[:, :3]

    @property
    def diameters(self) -> NDArray[np.float64]:
        """The diameters of the grains in mm; of other shapes those of the spheres of equal volume."""
        return self.grains[:, 3]

    @property
    def radii(self) -> NDArray[np.float64]:
        """Half of :attr:`diameters`, in mm."""
        return _fixed(self.diameters / 2)

    @property
    def sieve_sizes(self) -> NDArray[np.float64]:
        """The smallest square sieve opening that each grain passes, in mm: the diameter of a sphere."""
        found = self._column("sieve_mm")
        return self.diameters if found is None else found

    @property
    def semi_axes(self) -> NDArray[np.float64]:
        """The semi-axes ``a >= b >= c`` of the grains: an N x 3 array in mm. Polyhedra have none: NaN."""
        if "a_mm" in self.columns:
            first = self.columns.index("a_mm")
            axes = self.grains[:, first : first + 3].copy()
            axes[axes[:, 0] == 0] = np.nan
            return _fixed(axes)
        if "template" in self.columns:
            return _fixed(np.full((len(self.grains), 3), np.nan))
        return _fixed(np.repeat(self.radii[:, None], 3, axis=1))

    @property
    def quaternions(self) -> NDArray[np.float64]:
        """The orientations as unit quaternions w, x, y, z: an N x 4 array. Spheres are not turned: 1, 0, 0, 0."""
        if "qw" in self.columns:
            first = self.columns.index("qw")
            return self.grains[:, first : first + 4]
        turned = np.zeros((len(self.grains), 4))
        turned[:, 0] = 1
        return _fixed(turned)

    @property
    def orientations(self) -> Rotation:
        """The orientations as rotations of SciPy, from the axes of a grain to those of the specimen. Needs scipy.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.orientations[0].as_matrix().shape
        (3, 3)
        """
        with needed("scipy", "orientations", "packstone[scipy]"):
            from scipy.spatial.transform import Rotation
        return Rotation.from_quat(np.roll(self.quaternions, -1, axis=1))

    @property
    def aggregate(self) -> NDArray[np.int64]:
        """The index of the aggregate of each grain, from 0, as integers; 0 where the mix has one aggregate."""
        return self._indices("aggregate", 0)

    @property
    def template(self) -> NDArray[np.int64]:
        """The index of the template of each polyhedron in :meth:`templates`, as integers; -1 of other grains."""
        return self._indices("template", -1)

    def templates(self) -> list[dict[str, Any]]:
        """Returns the templates that :attr:`template` counts from 0; an empty list where no grain is a polyhedron.

        Each has ``vertices`` and ``faces`` of its core, ``rounding``, and derived figures, all in equivalent diameters.
        """
        if "template" not in self.columns:
            return []
        return list(json.loads(self._source.read(File("json", None, {}), None)).get("templates", []))

    def to_dataframe(self) -> pd.DataFrame:
        """Returns the grains as a table with the columns of :attr:`grains`; indices are integers. Needs pandas.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> list(packing.to_dataframe().columns)
        ['x_mm', 'y_mm', 'z_mm', 'd_mm']
        """
        with needed("pandas", "to_dataframe()", "packstone[dataframe]"):
            import pandas as pd

        frame = pd.DataFrame(self.grains, columns=list(self.columns), copy=True)
        whole = {name: np.int64 for name in ("template", "aggregate") if name in self.columns}
        return frame.astype(whole)

    def _column(self, name: str) -> NDArray[np.float64] | None:
        return self.grains[:, self.columns.index(name)] if name in self.columns else None

    def _indices(self, name: str, otherwise: int) -> NDArray[np.int64]:
        found = self._column(name)
        if found is None:
            return _fixed(np.full(len(self.grains), otherwise, dtype=np.int64))
        return _fixed(found.astype(np.int64))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        wanted = self.grains.dtype if dtype is None else np.dtype(dtype)
        if copy is False and wanted != self.grains.dtype:
            raise ValueError(f"grains are {self.grains.dtype}: {wanted} takes a copy")
        return self.grains.astype(wanted, copy=bool(copy))

    @cached_property
    def _count(self) -> int:
        return self._source.count()

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Grain]:
        rows = zip(self.positions, self.diameters.tolist(), self.sieve_sizes.tolist(), strict=True)
        indices = zip(self.aggregate.tolist(), self.template.tolist(), strict=True)
        for row, (aggregate, template) in zip(rows, indices, strict=True):
            yield Grain(*row, aggregate, template)

    def __bool__(self) -> bool:
        # Otherwise a truth test would fetch the number of grains, and a packing without any would be false.
        return True


def _fixed(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array
