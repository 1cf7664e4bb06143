"""Reads a lattice as Chrono does and adds it up: python chrono.py FOLDER EDGE"""

import sys
from pathlib import Path

import numpy as np

folder, edge = Path(sys.argv[1]), float(sys.argv[2])
nodes = np.loadtxt(folder / "ldpm-data-nodes.dat", comments="//")
tetrahedra = np.loadtxt(folder / "ldpm-data-tets.dat", comments="//", dtype=int)
facets = np.loadtxt(folder / "ldpm-data-facets.dat", comments="//")
particles = np.loadtxt(folder / "ldpm-data-particles.dat", comments="//")

corners = nodes[tetrahedra]
volumes = np.einsum("ni,ni->n", corners[:, 1] - corners[:, 0],
                    np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 0])) / 6
print(f"{len(nodes)} nodes, {len(particles)} of them grains, {len(tetrahedra)} tetrahedra, {len(facets)} facets")
print(f"smallest tetrahedron {volumes.min():.4f} mm3, all over the specimen {volumes.sum() / edge**3:.12f}")
print(f"volumes of the facets over the specimen {facets[:, 4].sum() / edge**3:.12f}")
