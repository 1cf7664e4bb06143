"""Draws docs/pictures/rivals.svg, CPU seconds beside other codes: python rivals.py rivals.svg (needs matplotlib)"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from cases import CASES

SHOWN = [
    "graded spheres, walls, 0.60",
    "graded spheres, walls, 0.70",
    "graded ellipsoids, periodic, 0.55",
    "1000 equal ellipsoids, 0.71",
    "400 cubes, 0.65",
    "400 tetrahedra, 0.59",
    "2000 equal spheres, 0.636",
]
# Seconds after which the other code was stopped.
STOPPED = {"NuTo": 60, "HOOMD-blue": 120}
OURS, OTHER, LEFT = "#3b5b7c", "#c9a26b", 0.02


def main():
    plt.rcParams.update({"svg.hashsalt": "rivals", "font.size": 9})
    figure, plot = plt.subplots(figsize=(7.4, 3.9), layout="constrained")
    rows = [case for case in CASES if case[0] in SHOWN]
    for row, (_, ours, other, seconds, _) in enumerate(reversed(rows)):
        plot.barh(row + 0.2, ours - LEFT, 0.36, color=OURS, left=LEFT)
        plot.text(ours * 1.1, row + 0.2, f"Packstone {ours:g} s", va="center", fontsize=8)
        shown = seconds or STOPPED[other]
        plot.barh(row - 0.2, shown - LEFT, 0.36, color=OTHER, hatch="" if seconds else "///", left=LEFT, ec="white")
        words = f"{other} {seconds:g} s" if seconds else f"{other}: not reached in {shown} s"
        plot.text(shown * 1.1, row - 0.2, words, va="center", fontsize=8)
    plot.set_yticks(range(len(rows)), [case[0] for case in reversed(rows)])
    plot.set(xscale="log", xlim=(LEFT, 5000), xlabel="CPU seconds up to the volume fraction, logarithmic")
    plot.set_xticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    plot.minorticks_off()
    plot.spines[["top", "right"]].set_visible(False)
    figure.savefig(sys.argv[1], metadata={"Date": None})


if __name__ == "__main__":
    main()
