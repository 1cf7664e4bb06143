"""Draws docs/pictures/blend.svg: three stockpiles, and their blend in the band of a standard with its residual.

    python blend.py PACKSTONE blend.svg        PACKSTONE is the program; needs matplotlib and numpy
"""

import json
import subprocess
import sys
import tempfile

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

PILES = {
    "sand 0/4": [[0.063, 0.01], [0.25, 0.18], [0.5, 0.42], [1, 0.66], [2, 0.87], [4, 0.97], [8, 1]],
    "gravel 4/10": [[2, 0.01], [4, 0.08], [6.3, 0.45], [10, 0.93], [14, 1]],
    "gravel 10/20": [[6.3, 0.01], [10, 0.08], [14, 0.40], [20, 0.92], [31.5, 1]],
}
TARGET = {"type": "band", "standard": "BS 882", "name": "all-in 20 mm"}
# Those of the standard, and one between 5 and 20 mm.
SIEVES = [0.15, 0.6, 5, 10, 20, 37.5]


def main():
    program, picture = sys.argv[1:]
    request = {
        "aggregates": [
            {"name": name, "grading": {"type": "sieves", "points": points}} for name, points in PILES.items()
        ],
        "target": TARGET,
        "sieves_mm": SIEVES,
    }
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(request, file)
        file.flush()
        command = [program, "mix", "blend", file.name, "--json"]
        answer = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    figure, (curves, residuals) = plt.subplots(
        2, 1, figsize=(6, 4.6), sharex=True, height_ratios=[4, 1], layout="constrained"
    )
    for pile, points in zip(answer["aggregates"], PILES.values()):
        d, passing = np.array(points).T
        curves.plot(d, 100 * passing, "--", linewidth=1, label=f"{pile['name']}: {100 * pile['share']:.1f} %")
    sieves = answer["sieves"]
    at, low, high, residual = (
        np.array([sieve[name] for sieve in sieves]) for name in ("sieve_mm", "target_low", "target_high", "residual")
    )
    curves.fill_between(at, 100 * low, 100 * high, alpha=0.25, label=f"{TARGET['standard']}, {TARGET['name']}")
    d, passing = np.array(answer["curve"]).T
    curves.plot(d, 100 * passing, "k", label="blend")
    curves.set(xscale="log", xlim=(0.063, 40), ylim=(0, 100), ylabel="passing, %")
    residuals.axhline(0, color="k", linewidth=0.5)
    residuals.vlines(at, 0, 100 * residual, linewidth=3)
    residuals.set(xlabel="sieve, mm", ylabel="outside, %", ylim=(-10, 10))
    residuals.set_xticks([0.063, 0.25, 1, 4, 16], ["0.063", "0.25", "1", "4", "16"])
    residuals.minorticks_off()
    for plot in (curves, residuals):
        plot.grid(alpha=0.3)
    curves.legend(fontsize=7, loc="upper left")
    figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    main()
