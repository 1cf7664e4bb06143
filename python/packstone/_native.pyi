"""The engine and the command line of Packstone, written in Rust (python/src/lib.rs).

Requests, options and documents are JSON text of the forms that `openapi.yaml` describes.
"""

from collections.abc import Callable
from os import PathLike
from typing import final

import numpy as np
from numpy.typing import NDArray

__version__: str

class Refused(Exception):
    """A request that is refused, or a packing that failed. `args` is the problem document as JSON."""

class Stopped(Exception):
    """A pack that another thread stopped."""

def main(args: list[str]) -> int:
    """Runs the command line and returns the exit code. The first argument is the name of the program."""

def plan(request: str, max_grains: int | None = None) -> str:
    """Returns the plan of a job, as ``POST /v1/plans`` answers it."""

def read_mix(
    table: bytes,
    *,
    sheet: str | None = None,
    curve: str | None = None,
    column: str | None = None,
    unit: str | None = None,
) -> str:
    """Returns what was understood of a grading or a recipe, as ``POST /v1/mixes/read`` answers it."""

def blend_mix(request: str) -> str:
    """Returns a blend of stockpiles, as ``POST /v1/mixes/blend`` answers it."""

def pack(
    request: str,
    *,
    max_grains: int | None = None,
    checkpoint: str | PathLike[str] | None = None,
    checkpoint_every_s: float = 30.0,
    on_progress: Callable[[str], None] | None = None,
) -> Packing:
    """Packs a job without the GIL. `on_progress` takes the progress as JSON; what it raises ends the run."""

def run_of_study(
    request: str, on_progress: Callable[[str], None] | None = None
) -> tuple[str, Packing | None]:
    """Packs a run of a study: its record (outcome, facts, curve, error) as JSON, and the packing if there is one."""

def companion(type: str, options: str, file_name: str) -> tuple[str, str] | None:
    """The file that belongs beside an export of that name, if one does: what its name adds, and its text."""

@final
class Packing:
    """A packing in memory."""

    @staticmethod
    def restore(stored: bytes) -> Packing:
        """Reads what :meth:`store` wrote."""

    def store(self) -> bytes:
        """The packing in the form in which a service stores it."""

    def summary(self) -> str:
        """The result without its grains, with its request."""

    def columns(self) -> list[str]:
        """The names of the columns of the grains."""

    def grains(self) -> NDArray[np.float64]:
        """The grains as a new array."""

    def table(self, format: str, path: str | PathLike[str]) -> None:
        """Writes the grains in a format to a file."""

    def table_bytes(self, format: str) -> bytes:
        """Returns the grains in a format."""

    def export(self, type: str, options: str, path: str | PathLike[str]) -> str:
        """Writes an export with its format and options to a file, and returns its report."""

    def plot(self, kind: str, title: bool, theme: str) -> str:
        """Returns a plot as SVG."""

    def picture(self, pixels: int) -> bytes:
        """Returns a picture with one octant removed, as PNG."""

    def __len__(self) -> int: ...

@final
class Study:
    """A study whose runs Python executes; the records of runs are those of :func:`run_of_study` with their places."""

    def __new__(cls, study: str) -> Study: ...
    def runs(self) -> str:
        """The study with its points and the request of each run."""

    def count(self, point: int, outcome: str) -> bool:
        """Counts a run that ended; whether no further run of its point is to be started."""

    def table(self, records: str, format: str) -> str:
        """Returns the table of the runs that have ended, as ``json`` or ``csv``."""

    def plot(
        self,
        kind: str,
        records: str,
        *,
        x: str | None = None,
        log_x: bool | None = None,
        title: bool = True,
        theme: str = "light",
    ) -> str:
        """Returns a plot of the table as SVG."""
