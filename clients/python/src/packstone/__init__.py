"""Client of Packstone: submit mixes and studies, wait for them, and get the packings as arrays.

    import packstone

    with packstone.Client("http://localhost:8080") as client:
        job = client.submit(
            specimen={"type": "box", "size_mm": [150, 150, 150]},
            mix={"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.7},
        )
        spheres = job.result().to_numpy()  # columns x, y, z and the diameter, in mm

What a job or a study may say is the server's to know (``openapi.yaml``): this package passes mappings on as
they are, and raises what the server refuses as :class:`PackstoneError`.
"""

from importlib.metadata import version

from .client import Client
from .completion import as_completed
from .derived import Derived
from .errors import (
    ConnectionFailed,
    Fault,
    JobCancelled,
    PackingNotReached,
    PackstoneError,
    WaitTimeout,
)
from .jobs import Job
from .results import Result
from .studies import Study, steps
from .svg import Svg

__version__ = version("packstone-client")

__all__ = [
    "Client",
    "ConnectionFailed",
    "Derived",
    "Fault",
    "Job",
    "JobCancelled",
    "PackingNotReached",
    "PackstoneError",
    "Result",
    "Study",
    "Svg",
    "WaitTimeout",
    "as_completed",
    "steps",
]
