"""Libraries that the package uses where they are installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def needed(library: str, purpose: str, install: str | None = None) -> Iterator[None]:
    """Says what to install where an import in the ``with`` statement fails.

    Parameters
    ----------
    library
        The library, as it is imported.
    purpose
        What needs it, as ``to_pyvista()``.
    install
        What ``pip install`` takes, `library` if it is not given.
    """
    try:
        yield
    except ImportError as error:
        message = f'{purpose} needs {library}: pip install "{install or library}"'
        raise ImportError(message, name=error.name, path=error.path) from error
