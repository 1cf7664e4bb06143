"""The packing of a job on a server."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _files
from ._requests import parameters
from ._stored import stored
from ._transport import Transport, document
from .exports import Export
from .options import ExportType

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._sources import File, PackingPlotKind, Theme
    from .local import Local


class Remote:
    """A source of :class:`Packing`: the result of a job, which is read from its server."""

    def __init__(self, transport: Transport, job_path: str, title: str) -> None:
        self._transport = transport
        self._job_path = job_path
        self.title = title
        self._report: dict[str, Any] | None = None

    def count(self) -> int:
        """The number of grains."""
        return int(self.report()["summary"]["grains"])

    def in_memory(self) -> Local:
        """The packing as this process would have made it: it is fetched with its grains."""
        from . import _native
        from .local import Local

        result = json.loads(self._download(f"{self._job_path}/result", {"format": "json"}))
        return Local(_native.Packing.restore(stored(result)))

    def report(self) -> dict[str, Any]:
        """The result without its grains."""
        if self._report is None:
            self._report = document(self._transport.request("GET", f"{self._job_path}/result/summary"))
        return self._report

    def request(self) -> dict[str, Any]:
        """The request of the job."""
        return document(self._transport.request("GET", f"{self._job_path}/request"))

    def columns(self) -> tuple[str, ...]:
        """The names of the columns of the grains: the first line of the format ``csv``."""
        headers = {"accept": "text/csv", "range": "bytes=0-1023"}
        answer = self._transport.request("GET", f"{self._job_path}/result", params={"format": "csv"}, headers=headers)
        return tuple(answer.text.splitlines()[0].split(","))

    def grains(self) -> NDArray[np.float64]:
        """The grains, of the format ``npy``."""
        import numpy as np

        content = io.BytesIO(self._download(f"{self._job_path}/result", {"format": "npy"}))
        grains: NDArray[np.float64] = np.load(content, allow_pickle=False)
        return grains

    def read(self, file: File, timeout: float | None) -> bytes:
        """Downloads a file."""
        return self._download(*self._address(file), timeout)

    def save(self, file: File, path: Path, timeout: float | None) -> None:
        """Downloads a file to a path; what is doubtful about an export is issued as a warning."""
        if file.type is not None:
            self.export(file.type, {"format": file.format, **file.options}, path, timeout)
            return
        address, params = self._address(file)
        _files.save(self._transport, address, path, params, timeout)

    def export(
        self, type: ExportType, options: Mapping[str, Any], path: Path, timeout: float | None
    ) -> dict[str, Any]:
        """Lets the server make an export that it need not keep, and downloads it."""
        params = {"keep": False, **parameters(options)}
        response = self._transport.request(
            "POST", f"{self._job_path}/exports/{type}", params=params, repeatable=True
        )
        export = Export(self._transport, document(response), response.headers.get("etag"))
        export.save(path, timeout)
        return export.report

    def plot(self, kind: PackingPlotKind, title: bool, theme: Theme) -> str:
        """A plot as the server draws it."""
        response = self._transport.request(
            "GET",
            f"{self._job_path}/plots/{kind}",
            params={"title": title, "theme": theme},
            headers={"accept": "image/svg+xml"},
        )
        return response.text

    def picture(self, pixels: int) -> bytes:
        """A picture, drawn in this process: the grains are fetched."""
        return self.in_memory().picture(pixels)

    def _download(self, address: str, params: dict[str, Any], timeout: float | None = None) -> bytes:
        buffer = io.BytesIO()
        self._transport.download(address, buffer, params=params, timeout=timeout)
        return buffer.getvalue()

    def _address(self, file: File) -> tuple[str, dict[str, Any]]:
        params = {"format": file.format, **parameters(file.options)}
        name = "result" if file.type is None else f"exports/{file.type}"
        return f"{self._job_path}/{name}", params
