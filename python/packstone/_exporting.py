"""The exports of a packing and of a job: one typed function for each."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from . import _files
from ._requests import named, parameters
from ._resource import Resource
from ._sources import Source
from ._transport import document
from .exports import Export
from .options import check_options

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .options import (
        CertificateFormat,
        CertificateOptions,
        DeckFormat,
        DeckOptions,
        LdpmFormat,
        LdpmOptions,
        MeshFormat,
        MeshOptions,
        NoOptions,
        PropertyFormat,
        PropertyOptions,
        QualityFormat,
        ShapeFormat,
        SliceFormat,
        SliceOptions,
        VoxelFormat,
        VoxelOptions,
    )
    from .reports import (
        CertificateReport,
        DeckReport,
        LatticeReport,
        MeshReport,
        PropertyReport,
        QualityReport,
        ShapeTableReport,
        SliceReport,
        VoxelReport,
    )


class PackingExports:
    """The exports of a :class:`Packing`."""

    _source: Source

    @overload
    def export(
        self,
        type: Literal["mesh"],
        path: str | PathLike[str],
        *,
        format: MeshFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[MeshOptions],
    ) -> MeshReport: ...
    @overload
    def export(
        self,
        type: Literal["voxels"],
        path: str | PathLike[str],
        *,
        format: VoxelFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[VoxelOptions],
    ) -> VoxelReport: ...
    @overload
    def export(
        self,
        type: Literal["slice"],
        path: str | PathLike[str],
        *,
        format: SliceFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[SliceOptions],
    ) -> SliceReport: ...
    @overload
    def export(
        self,
        type: Literal["deck"],
        path: str | PathLike[str],
        *,
        format: DeckFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[DeckOptions],
    ) -> DeckReport: ...
    @overload
    def export(
        self,
        type: Literal["ldpm"],
        path: str | PathLike[str],
        *,
        format: LdpmFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[LdpmOptions],
    ) -> LatticeReport: ...
    @overload
    def export(
        self,
        type: Literal["certificates"],
        path: str | PathLike[str],
        *,
        format: CertificateFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[CertificateOptions],
    ) -> CertificateReport: ...
    @overload
    def export(
        self,
        type: Literal["shapes"],
        path: str | PathLike[str],
        *,
        format: ShapeFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[NoOptions],
    ) -> ShapeTableReport: ...
    @overload
    def export(
        self,
        type: Literal["quality"],
        path: str | PathLike[str],
        *,
        format: QualityFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[NoOptions],
    ) -> QualityReport: ...
    @overload
    def export(
        self,
        type: Literal["properties"],
        path: str | PathLike[str],
        *,
        format: PropertyFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[PropertyOptions],
    ) -> PropertyReport: ...
    def export(
        self,
        type: Any,
        path: str | PathLike[str],
        *,
        format: str | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Any,
    ) -> Any:
        """Writes an export of any type and format to a file, and returns its figures.

        Parameters
        ----------
        type
            ``mesh``, ``voxels``, ``slice``, ``deck``, ``ldpm``, ``certificates``, ``shapes``, ``quality`` or
            ``properties``.
        path
            The file. Missing folders are created. Beside a mesh for Gmsh its script is written, as :meth:`save` does.
        format
            One of the formats of the type, the first of them if it is not named, whatever the suffix.
        timeout
            Longest wait for a server in s. A server does not keep the file: :meth:`Job.export` does.
        overwrite
            Whether a file of the same name is replaced.
        **options
            Those of the type, in :mod:`packstone.options`. An option that is a word of Python has an underscore behind
            it: ``for_="damask"``.

        Returns
        -------
        dict
            The figures of the export, such as its number of triangles: a type of :mod:`packstone.reports`.

        Raises
        ------
        InvalidRequest
            For an option or a value that the export does not have.
        FileExistsError
            If the file exists.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.export("voxels", "labels.npy", format="npy", cells=20)["shape"]
        [20, 20, 20]
        >>> packing.export("mesh", "a.msh", segmets=8)
        Traceback (most recent call last):
        packstone.errors.InvalidRequest: Invalid argument: segmets: unknown option: mesh has ...; did you mean segments?
        """
        check_options(type, options)
        given = named(options if format is None else {"format": format, **options})
        _files.refuse_existing(path, overwrite)
        report = self._source.export(type, given, Path(path), timeout)
        _files.write_companion(Path(path), type, given)
        return report


class JobExports(Resource):
    """The exports of a :class:`Job`."""

    @overload
    def export(
        self,
        type: Literal["mesh"],
        /,
        *,
        format: MeshFormat | None = None,
        keep: bool = True,
        **options: Unpack[MeshOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["voxels"],
        /,
        *,
        format: VoxelFormat | None = None,
        keep: bool = True,
        **options: Unpack[VoxelOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["slice"],
        /,
        *,
        format: SliceFormat | None = None,
        keep: bool = True,
        **options: Unpack[SliceOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["deck"],
        /,
        *,
        format: DeckFormat | None = None,
        keep: bool = True,
        **options: Unpack[DeckOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["ldpm"],
        /,
        *,
        format: LdpmFormat | None = None,
        keep: bool = True,
        **options: Unpack[LdpmOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["certificates"],
        /,
        *,
        format: CertificateFormat | None = None,
        keep: bool = True,
        **options: Unpack[CertificateOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["shapes"],
        /,
        *,
        format: ShapeFormat | None = None,
        keep: bool = True,
        **options: Unpack[NoOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["quality"],
        /,
        *,
        format: QualityFormat | None = None,
        keep: bool = True,
        **options: Unpack[NoOptions],
    ) -> Export: ...
    @overload
    def export(
        self,
        type: Literal["properties"],
        /,
        *,
        format: PropertyFormat | None = None,
        keep: bool = True,
        **options: Unpack[PropertyOptions],
    ) -> Export: ...
    def export(self, type: Any, /, *, format: str | None = None, keep: bool = True, **options: Any) -> Export:
        """Starts an export on the server. :meth:`Export.save` waits for its file.

        The same type, format and options are the same export, which is made once.

        Parameters
        ----------
        type
            ``mesh``, ``voxels``, ``slice``, ``deck``, ``ldpm``, ``certificates``, ``shapes``, ``quality`` or
            ``properties``.
        format
            One of the formats of the type, the first of them if it is not named.
        keep
            Whether the file stays with the job; otherwise it is a cache that the server may remove.
        **options
            Those of the type, in :mod:`packstone.options`, as for :meth:`Packing.export`.
        """
        check_options(type, options)
        params = {"format": format, "keep": keep, **parameters(options)}
        response = self._transport.request(
            "POST", f"{self.path}/exports/{type}", params=params, repeatable=True
        )
        return Export(self._transport, document(response), response.headers.get("etag"))
