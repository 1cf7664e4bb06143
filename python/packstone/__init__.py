"""Packstone packs the aggregate of a concrete mix and checks the packing: in this process, or by a service.

    import packstone

    packing = packstone.pack(specimen=packstone.Box(150), mix=packstone.Mix("A16", 0.7, d_min_mm=2), seed=1)
    packing.positions, packing.diameters  # arrays, in mm

    with packstone.Client("http://localhost:8080") as client:
        job = client.submit(specimen=packstone.Box(150), mix=packstone.Mix("A16", 0.7, d_min_mm=2), seed=1)
        packing = job.result()  # the same packing

The engine checks requests, here and on the server: ``openapi.yaml`` has all fields and bounds. What it refuses is
raised as :class:`PackstoneError`.
"""

from ._native import __version__ as __version__
from ._archives import Lattice
from ._conversions import Neighbours
from ._grain_arrays import Grain
from .aio import AsyncClient, AsyncExport, AsyncJob, AsyncPacking, AsyncStudy
from .blends import Blend, BlendedSieve
from .builders import Box, Cylinder, Distance, Method, Segregation, Specimen
from .client import Client
from .completion import as_completed
from .errors import (
    ConnectionFailed,
    Fault,
    InvalidRequest,
    JobCancelled,
    PackstoneError,
    PackstoneWarning,
    TargetNotReached,
    WaitTimeout,
)
from .exports import Export
from .gallery import example, examples
from .gradings import Grading
from .jobs import Job
from .loading import load
from .local import pack, plan
from .local_studies import LocalStudy, study
from .mixes import Addition, Aggregate, Mix, Proportions
from .packings import Packing
from .picture import Picture
from .readings import MixBand, MixCandidate, MixCurve, MixNote, MixPart, MixReading, MixRecipe
from .shapes import Ratios, Shape
from .studies import Study, steps
from .svg import Svg
from .view import View

__all__ = [
    "Addition",
    "Aggregate",
    "AsyncClient",
    "AsyncExport",
    "AsyncJob",
    "AsyncPacking",
    "AsyncStudy",
    "Blend",
    "BlendedSieve",
    "Box",
    "Client",
    "ConnectionFailed",
    "Cylinder",
    "Distance",
    "Export",
    "Fault",
    "Grading",
    "Grain",
    "InvalidRequest",
    "Job",
    "JobCancelled",
    "Lattice",
    "LocalStudy",
    "Method",
    "Mix",
    "MixBand",
    "MixCandidate",
    "MixCurve",
    "MixNote",
    "MixPart",
    "MixReading",
    "MixRecipe",
    "Neighbours",
    "Packing",
    "PackstoneError",
    "PackstoneWarning",
    "Picture",
    "Proportions",
    "Ratios",
    "Segregation",
    "Shape",
    "Specimen",
    "Study",
    "Svg",
    "TargetNotReached",
    "View",
    "WaitTimeout",
    "as_completed",
    "example",
    "examples",
    "plan",
    "load",
    "pack",
    "steps",
    "study",
]
