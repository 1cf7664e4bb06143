"""Draws docs/pictures/gradient.png: the middle of a cube packed without and with a gradient.

    python gradient.py PACKSTONE gradient.png        PACKSTONE is the program; needs matplotlib and numpy
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle

EDGE_MM = 60


def packing(program, strength):
    job = {
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [EDGE_MM] * 3},
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5},
            "d_min_mm": 2,
            "volume_fraction": 0.65,
            "volume_fraction_of": "placed_grains",
        },
        "method": {"type": "edmd"},
        "segregation": {"type": "gradient", "field": {"type": "linear", "axis": "z"}, "strength": strength},
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "job.json")
        path.write_text(json.dumps(job))
        subprocess.run([program, "run", path, "--out", folder, "--format", "npy"], check=True, capture_output=True)
        return np.load(Path(folder, "result.npy"))


def main():
    program, target = sys.argv[1:]
    figure, plots = plt.subplots(1, 3, figsize=(9, 3.4), layout="constrained")
    for plot, strength in zip(plots, (0, 10, 100)):
        x, y, z, d = packing(program, strength).T
        half = (d / 2) ** 2 - (y - EDGE_MM / 2) ** 2
        cut = half > 0
        circles = [Circle(at, r) for *at, r in zip(x[cut], z[cut], np.sqrt(half[cut]))]
        patches = PatchCollection(circles, cmap="viridis", edgecolor="black", linewidth=0.3)
        patches.set_array(d[cut])
        patches.set_clim(2, 16)
        plot.add_collection(patches)
        plot.set(xlim=(0, EDGE_MM), ylim=(0, EDGE_MM), aspect="equal", title=f"strength {strength}", xlabel="x, mm", ylabel="z, mm")
    figure.colorbar(patches, ax=plots, label="diameter, mm")
    figure.savefig(target, dpi=170)


if __name__ == "__main__":
    main()
