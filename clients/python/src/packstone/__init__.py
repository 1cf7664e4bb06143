"""Client of Packstone: submits mixes and studies, waits for them, and returns packings as arrays.

    import packstone

    with packstone.Client("http://localhost:8080") as client:
        job = client.submit(specimen=packstone.Box(150), mix=packstone.Mix("A16", 0.7, d_min_mm=2), seed=1)
        grains = job.result().to_numpy()  # columns x, y, z and the diameter, in mm

The server checks requests: ``openapi.yaml`` has all fields and bounds. The client sends mappings as they are and
raises what the server refuses as :class:`PackstoneError`.
"""

from importlib.metadata import version

from .aio import AsyncClient, AsyncExport, AsyncJob, AsyncResult, AsyncStudy
from .builders import (
    Addition,
    Aggregate,
    Box,
    Cylinder,
    Distance,
    Grading,
    Method,
    Mix,
    Proportions,
    Ratios,
    Segregation,
    Shape,
    Specimen,
)
from .client import Client
from .completion import as_completed
from .errors import (
    ConnectionFailed,
    Fault,
    JobCancelled,
    PackstoneError,
    PackstoneWarning,
    TargetNotReached,
    WaitTimeout,
)
from .exports import Export
from .jobs import Job
from .results import Result
from .studies import Study, steps
from .svg import Svg

__version__ = version("packstone-client")

__all__ = [
    "Addition",
    "Aggregate",
    "AsyncClient",
    "AsyncExport",
    "AsyncJob",
    "AsyncResult",
    "AsyncStudy",
    "Box",
    "Client",
    "ConnectionFailed",
    "Cylinder",
    "Distance",
    "Export",
    "Fault",
    "Grading",
    "Job",
    "JobCancelled",
    "Method",
    "Mix",
    "PackstoneError",
    "PackstoneWarning",
    "Proportions",
    "Ratios",
    "Result",
    "Segregation",
    "Shape",
    "Specimen",
    "Study",
    "Svg",
    "TargetNotReached",
    "WaitTimeout",
    "as_completed",
    "steps",
]
