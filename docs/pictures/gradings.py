"""Draws docs/pictures/gradings.svg: curves by formulas, laws of sizes, and a band of a standard with its curves.

    python gradings.py PACKSTONE gradings.svg        PACKSTONE is the program; needs matplotlib and numpy
"""

import json
import subprocess
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

FORMULAS = {
    "Fuller, q = 0.5": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5},
    "Andreasen, q = 0.3, from 0.25 mm": {"type": "andreasen", "d_min_mm": 0.25, "d_max_mm": 16, "exponent": 0.3},
    "Bolomey, A = 12 %": {"type": "bolomey", "d_max_mm": 16, "a_percent": 12},
    "Faury, A = 24 %": {"type": "faury", "d_max_mm": 16, "a_percent": 24},
    "Dreux-Gorisse, K = 2 %": {"type": "dreux_gorisse", "d_max_mm": 16, "k_percent": 2},
}
LAWS = {
    "lognormal by mass": {"type": "lognormal", "median_mm": 6, "sigma": 0.4},
    "lognormal by number": {"type": "lognormal", "median_mm": 6, "sigma": 0.4, "by": "number"},
    "normal by mass": {"type": "normal", "mean_mm": 6, "standard_deviation_mm": 1.5},
    "Rosin-Rammler, n = 2": {"type": "rosin_rammler", "characteristic_mm": 6, "exponent": 2},
}


def curve(program, grading):
    """What passes each diameter, as the program plans it."""
    job = {
        "specimen": {"type": "box", "size_mm": [500] * 3},
        "mix": {"grading": grading, "d_min_mm": 5, "volume_fraction": 0.2},
    }
    plan = subprocess.run([program, "plan", "-"], input=json.dumps(job), capture_output=True, text=True, check=True)
    return np.array(json.loads(plan.stdout)["curve"]).T


def main():
    program, target = sys.argv[1:]
    figure, plots = plt.subplots(1, 3, figsize=(10, 3.6), sharey=True, layout="constrained")
    for plot, gradings in zip(plots, (FORMULAS, LAWS)):
        for name, grading in gradings.items():
            d, passing = curve(program, grading)
            plot.plot(d, 100 * passing, label=name)
    band = {"type": "standard", "standard": "ASTM C33", "name": "57"}
    lower, upper = (curve(program, {**band, "curve": limit}) for limit in ("lower", "upper"))
    d = np.geomspace(1, 40, 400)
    low, high = (100 * np.interp(np.log(d), np.log(sieves), passing) for sieves, passing in (lower, upper))
    plots[2].fill_between(d, low, high, alpha=0.25, label="limits of ASTM C33, size 57")
    d, passing = curve(program, {**band, "curve": "middle"})
    plots[2].plot(d, 100 * passing, label="middle")
    for plot in plots:
        plot.set(xscale="log", xlim=(0.25, 40), ylim=(0, 100), xlabel="sieve, mm")
        plot.set_xticks([0.25, 1, 4, 16], ["0.25", "1", "4", "16"])
        plot.minorticks_off()
        plot.grid(alpha=0.3)
        plot.legend(fontsize=7, loc="upper left")
    plots[0].set_ylabel("passing, % of the mass")
    figure.savefig(target, metadata={"Date": None})


if __name__ == "__main__":
    main()
