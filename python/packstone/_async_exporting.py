"""The exports of a packing and of a job for programs that use asyncio."""

from __future__ import annotations

from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, overload

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .aio import AsyncExport, _Threads
    from .jobs import Job
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
    from .packings import Packing
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


class AsyncPackingExports:
    """The exports of an :class:`AsyncPacking`."""

    _threads: _Threads
    sync: Packing

    @overload
    async def export(
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
    async def export(
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
    async def export(
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
    async def export(
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
    async def export(
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
    async def export(
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
    async def export(
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
    async def export(
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
    async def export(
        self,
        type: Literal["properties"],
        path: str | PathLike[str],
        *,
        format: PropertyFormat | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[PropertyOptions],
    ) -> PropertyReport: ...
    async def export(
        self,
        type: Any,
        path: str | PathLike[str],
        *,
        format: str | None = None,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Any,
    ) -> Any:
        """See :meth:`Packing.export`."""
        given: dict[str, Any] = {"format": format, "timeout": timeout, "overwrite": overwrite, **options}
        return await self._threads.call(partial(self.sync.export, type, path, **given))


class AsyncJobExports:
    """The exports of an :class:`AsyncJob`."""

    _threads: _Threads
    sync: Job

    @overload
    async def export(
        self,
        type: Literal["mesh"],
        /,
        *,
        format: MeshFormat | None = None,
        keep: bool = True,
        **options: Unpack[MeshOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["voxels"],
        /,
        *,
        format: VoxelFormat | None = None,
        keep: bool = True,
        **options: Unpack[VoxelOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["slice"],
        /,
        *,
        format: SliceFormat | None = None,
        keep: bool = True,
        **options: Unpack[SliceOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["deck"],
        /,
        *,
        format: DeckFormat | None = None,
        keep: bool = True,
        **options: Unpack[DeckOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["ldpm"],
        /,
        *,
        format: LdpmFormat | None = None,
        keep: bool = True,
        **options: Unpack[LdpmOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["certificates"],
        /,
        *,
        format: CertificateFormat | None = None,
        keep: bool = True,
        **options: Unpack[CertificateOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["shapes"],
        /,
        *,
        format: ShapeFormat | None = None,
        keep: bool = True,
        **options: Unpack[NoOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["quality"],
        /,
        *,
        format: QualityFormat | None = None,
        keep: bool = True,
        **options: Unpack[NoOptions],
    ) -> AsyncExport: ...
    @overload
    async def export(
        self,
        type: Literal["properties"],
        /,
        *,
        format: PropertyFormat | None = None,
        keep: bool = True,
        **options: Unpack[PropertyOptions],
    ) -> AsyncExport: ...
    async def export(self, type: Any, /, *, format: str | None = None, keep: bool = True, **options: Any) -> Any:
        """See :meth:`Job.export`."""
        from .aio import AsyncExport

        given: dict[str, Any] = {"format": format, "keep": keep, **options}
        return AsyncExport(self._threads, await self._threads.call(partial(self.sync.export, type, **given)))
