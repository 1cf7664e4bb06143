"""NumPy, which is imported when it is first used: `import packstone` takes half of its time without it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
else:

    class _Numpy:
        def __getattr__(self, name):
            import numpy

            return getattr(numpy, name)

    np = _Numpy()

__all__ = ["np"]
