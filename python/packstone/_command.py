"""The command ``packstone``."""

from __future__ import annotations

import sys


def main() -> int:
    """Runs the command line of this process and returns its exit code."""
    from . import _native

    return _native.main(sys.argv)
