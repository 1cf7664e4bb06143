"""Reads again what the package, the commands and a service have written."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn

from . import _archives, _native, _stored
from ._numpy import np
from ._optional import needed
from ._tabular import INDICES, SPHERES, Tabular, columns_of
from .local import Local
from .local_studies import LocalStudy
from .packings import Packing
from .svg import Svg
from .view import View

# The tables of a packing that can be read, the fullest first.
READABLE_TABLES = ("json", "csv", "npy")


def load(path: str | PathLike[str]) -> Any:
    """Reads a file or a folder that Packstone has written, and returns what was saved.

    Parameters
    ----------
    path
        The file, or the folder of ``packstone run``, ``packstone study``, :meth:`LocalStudy.save` or ``save_all``.

    Returns
    -------
    Any
        By the form of the file:

        - :class:`Packing`: a result as ``json``, or the file in which a service stores it, with everything; a table of
          the grains as ``csv`` or ``npy``, with the grains alone; the folder of ``packstone run``.
        - :class:`LocalStudy`: the folder of a study, with its table, its plots and the packings that it kept.
        - A dictionary of packings by the name of their file: a folder of packings.
        - NumPy's arrays: voxels as ``npy``, or as ``raw`` where their report lies beside them.
        - Objects of PyVista: ``vtp``, ``vtk``, ``vti``, ``vtu``; a dictionary of them: surfaces as ``stl`` in a zip.
        - A mesh of meshio: ``msh``, ``med``, and voxels, tetrahedra or triangles as ``inp``.
        - :class:`Lattice`: the zip of the export ``ldpm``.
        - :class:`Svg`, :class:`View`: plots and pages with a viewer (``html``).
        - Tables of pandas: other files as ``csv``.
        - A dictionary: the folder of ``packstone solve``, with the properties that it computed.
        - Dictionaries: all other documents of JSON, such as requests, reports and tables of studies.

    Raises
    ------
    ValueError
        If the file is for another reader, which the message names, or is damaged.
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> packing = packstone.pack(specimen=packstone.Box(40), mix=packstone.Mix("A16", 0.3, d_min_mm=4), seed=1)
    >>> saved = packing.save("packings/a16.json")
    >>> again = packstone.load("packings/a16.json")
    >>> bool((again.grains == packing.grains).all())
    True
    """
    path = Path(path)
    if path.is_dir():
        return _folder(path)
    with path.open("rb") as file:
        head = file.read(8)
    if _stored.is_stored(head):
        return _restored(path, path.read_bytes())
    if head == b"PACKSTCK":
        _other(path, "a checkpoint", f'packstone.pack(request, checkpoint="{path.name}") goes on from it')
    ending = path.suffix.removeprefix(".").lower()
    reader = READERS.get(ending)
    if reader is None:
        _other(path, f"a file of the kind {ending or 'without an ending'}", f"it must be one of {', '.join(READERS)}")
    return reader(path)


def _folder(path: Path) -> Any:
    if (path / "study.json").exists() and (path / "runs.jsonl").exists():
        return LocalStudy.open(path)
    if (path / "packstone.sqlite").exists():
        _other(path, "the data directory of a service", f"`packstone serve --data-dir {path.name}` and Client read it")
    if (path / "solution.json").exists():
        return _json(path / "solution.json")
    if (path / "deck.json").exists():
        _other(path, "a deck of a solver", f"`packstone solve {path.name}` runs CalculiX on it")
    for ending in READABLE_TABLES:
        if (path / f"result.{ending}").exists():
            return load(path / f"result.{ending}")
    packings = packings_in(path)
    if not packings:
        found = ", ".join(sorted(file.name for file in path.iterdir())[:6]) or "nothing"
        raise ValueError(
            f"{path} holds no packing as json, csv or npy and no study, but {found}: load one of its files"
        )
    return packings


def packings_in(path: Path) -> dict[str, Packing]:
    """Returns the packings that lie in a folder by the names of their files; one of several formats is read once."""
    found: dict[str, Packing] = {}
    for ending in READABLE_TABLES:
        for file in sorted(path.glob(f"*.{ending}")):
            if file.stem in found or file.name.endswith(".report.json"):
                continue
            read = None if ending == "csv" and not _has_grains(file) else load(file)
            if isinstance(read, Packing):
                found[file.stem] = read
    return found


def _json(path: Path) -> Any:
    try:
        document = json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path.name} is damaged or is not JSON: {error}") from None
    if not _stored.is_result(document):
        return document
    return _restored(path, _stored.stored(document))


def _restored(path: Path, content: bytes) -> Packing:
    try:
        return Packing(Local(_native.Packing.restore(content)))
    except OSError as error:
        raise ValueError(f"{path.name} cannot be read: {error}") from None


def _has_grains(path: Path) -> bool:
    """Whether a table as CSV is one of grains."""
    with path.open(encoding="utf-8-sig") as lines:
        return lines.readline().startswith(",".join(SPHERES))


def _csv(path: Path) -> Any:
    with path.open(encoding="utf-8-sig") as lines:
        columns = lines.readline().rstrip("\r\n").split(",")
        if _has_grains(path):
            grains = np.loadtxt(lines, delimiter=",", ndmin=2).reshape(-1, len(columns))
            return Packing(Tabular(path, columns, grains))
    with needed("pandas", f"the table {path.name}"):
        import pandas as pd
    return pd.read_csv(path)


def _npy(path: Path) -> Any:
    array = np.load(path, allow_pickle=False)
    if array.ndim == 2 and array.dtype == np.float64:
        columns = columns_of(array)
        if columns is not None:
            return Packing(Tabular(path, columns, array))
    return array


def _raw(path: Path) -> Any:
    report = path.with_name(f"{path.name}.report.json")
    if not report.exists():
        _other(
            path,
            "labels of voxels without their shape",
            "numpy.fromfile(path, dtype).reshape(shape, order='F') reads it, with dtype and shape of the report that "
            "`export` returned",
        )
    figures = json.loads(report.read_bytes())
    return np.fromfile(path, figures["dtype"]).reshape(figures["shape"], order="F")


def _pyvista(path: Path) -> Any:
    with needed("pyvista", path.name):
        import pyvista
    return pyvista.read(path)


def _meshio(path: Path) -> Any:
    with needed("meshio", path.name):
        import meshio
    try:
        mesh = meshio.read(path)
    # meshio ends the program, or raises what its readers do.
    except (Exception, SystemExit) as error:
        _other(path, "a file that meshio cannot read", f"Gmsh, Abaqus or CalculiX open it ({error})")
    if len(mesh.points) == 0:
        _other(path, "a part of a deck without a mesh", "Abaqus and CalculiX include it; meshio.read reads mesh.inp")
    return mesh


def _dat(path: Path) -> NoReturn:
    if path.name.startswith(_archives.LATTICE):
        who = 'packstone.load reads its zip, numpy.loadtxt(path, comments="//") the file'
        _other(path, "a table of a lattice", who)
    _other(path, "an output of CalculiX", "`packstone solve` of its folder computes what follows from it")


def _reads(kind: str, who: str) -> Callable[[Path], Any]:
    """A reader that names another."""

    def refuse(path: Path) -> NoReturn:
        _other(path, kind, who.format(name=path.name))

    return refuse


def _other(path: Path, kind: str, who: str) -> NoReturn:
    raise ValueError(f"{path.name} is {kind}: {who}")


READERS: Mapping[str, Callable[[Path], Any]] = {
    "json": _json,
    "csv": _csv,
    "npy": _npy,
    "raw": _raw,
    "vtp": _pyvista,
    "vtk": _pyvista,
    "vti": _pyvista,
    "vtu": _pyvista,
    "stl": _pyvista,
    "msh": _meshio,
    "med": _meshio,
    "inp": _meshio,
    "zip": _archives.read,
    "svg": lambda path: Svg(path.read_text(encoding="utf-8")),
    "html": lambda path: View(path.read_text(encoding="utf-8"), 640),
    "png": _reads("a picture", "matplotlib.pyplot.imread and IPython.display.Image read it"),
    "view": _reads("the form of the viewer", "the viewer of the page reads it; of a packing, Packing.view() shows it"),
    "geo": _reads("a script", "`gmsh {name}` opens it"),
    "jsonl": _reads("the runs of a study", "packstone.load reads its folder"),
    "dat": _dat,
    "frd": _reads("an output of CalculiX", "`cgx {name}` and ccx2paraview open it"),
    "sta": _reads("an output of CalculiX", "it is a text for people"),
    "log": _reads("a log", "it is a text for people"),
    "pkl": _reads("a pickle", "pickle.load reads it"),
    "xlsx": _reads("a workbook", "packstone.Mix.read reads gradings and recipes in it"),
    "ods": _reads("a workbook", "packstone.Mix.read reads gradings and recipes in it"),
    "txt": _reads("a text", "packstone.Mix.read reads gradings and recipes in it"),
    "sh": _reads("a script", "`sbatch {name}` submits it"),
}
