"""Compares random sequential addition with hard-particle Monte Carlo at a volume fraction that both reach.

    python disorder.py OUT.png PACKSTONE [SEEDS]

Runs the given binary for ellipsoids 1.5 : 1.2 : 1, Fuller 2..16 mm, in a cube of 80 mm, at 0.55, and draws the pair
correlation of the grains below 4 mm, the order of their long axes by distance, the density of centres near walls, and
the orientation of short axes near walls. Needs the wheels `numpy` and `matplotlib`.
"""

import csv
import json
import subprocess
import sys
import tempfile

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

SIZE_MM = 80.0
# Grains whose pairs are counted, and how far, in mean diameters of the pair.
LARGEST_MM, REACH = 4.0, 3.0
PAIR_BINS = np.linspace(0.6, REACH, 49)
# Centres by distance from a wall, in equivalent diameters.
WALL_BINS = np.linspace(0.3, 3.0, 28)
METHODS = {"rsa": "random sequential addition", "monte_carlo": "hard-particle Monte Carlo"}


def grains(binary: str, method: str, seed: int) -> dict[str, np.ndarray]:
    request = {
        "specimen": {"type": "box", "size_mm": [SIZE_MM] * 3},
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2, "volume_fraction": 0.55,
            "volume_fraction_of": "placed_grains", "size": "equivalent",
            "shape": {"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 2 / 3}},
        },
        "method": {"type": method}, "seed": seed,
    }
    with tempfile.TemporaryDirectory() as folder:
        command = [binary, "run", "-", "--format", "csv", "--out", folder]
        subprocess.run(command, input=json.dumps(request), stdout=subprocess.DEVNULL, text=True, check=True)
        with open(f"{folder}/result.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def axes(table: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Long and short axes of the grains."""
    w, x, y, z = (table[name] for name in ("qw", "qx", "qy", "qz"))
    long_axis = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], 1)
    short_axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], 1)
    return long_axis, short_axis


def measure(table: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Counts of pairs, their ideal number, sums of their order; counts near walls, their ideal, sums of order."""
    d = table["d_mm"]
    at = np.stack([table[f"{axis}_mm"] for axis in "xyz"], 1)
    long_axis, short_axis = axes(table)
    small = d < LARGEST_MM
    p, size, direction = at[small], d[small], long_axis[small]
    margin = REACH * LARGEST_MM
    inner = np.flatnonzero(np.all((p > margin) & (p < SIZE_MM - margin), axis=1))
    density = len(inner) / (SIZE_MM - 2 * margin) ** 3
    found, ideal, order = (np.zeros(len(PAIR_BINS) - 1) for _ in range(3))
    for i in inner:
        r = np.linalg.norm(p - p[i], axis=1)
        r[i] = np.inf
        near = np.flatnonzero(r < margin)
        scaled = r[near] / ((size[near] + size[i]) / 2)
        p2 = 1.5 * (direction[near] @ direction[i]) ** 2 - 0.5
        found += np.histogram(scaled, PAIR_BINS)[0]
        order += np.histogram(scaled, PAIR_BINS, weights=p2)[0]
        shell = 4 / 3 * np.pi * (PAIR_BINS[1:] ** 3 - PAIR_BINS[:-1] ** 3)
        ideal += density * shell * np.mean(((size + size[i]) / 2) ** 3)
    walls, room, tilt = (np.zeros(len(WALL_BINS) - 1) for _ in range(3))
    for axis in range(3):
        for distance in (at[:, axis], SIZE_MM - at[:, axis]):
            scaled = distance / d
            p2 = 1.5 * short_axis[:, axis] ** 2 - 0.5
            walls += np.histogram(scaled, WALL_BINS)[0]
            tilt += np.histogram(scaled, WALL_BINS, weights=p2)[0]
            room += np.diff(WALL_BINS) * np.sum(d) / SIZE_MM
    return [found, ideal, order, walls, room, tilt]


def main(out: str, binary: str, seeds: int = 16) -> None:
    figure, ((pairs, order), (walls, tilt)) = plt.subplots(2, 2, figsize=(10, 7), constrained_layout=True)
    for method, label in METHODS.items():
        runs = [measure(grains(binary, method, seed)) for seed in range(1, seeds + 1)]
        found, ideal, sums, near, room, tilts = (np.sum(parts, axis=0) for parts in zip(*runs))
        x = (PAIR_BINS[1:] + PAIR_BINS[:-1]) / 2
        y = (WALL_BINS[1:] + WALL_BINS[:-1]) / 2
        pairs.plot(x, found / ideal, label=label)
        order.plot(x, sums / np.maximum(found, 1), label=label)
        walls.plot(y, near / room, label=label)
        tilt.plot(y, tilts / np.maximum(near, 1), label=label)
        print(f"{method}: pair correlation at most {np.max(found / ideal):.3f}, "
              f"density near walls at most {np.max(near / room):.3f}, "
              f"largest order of neighbours {np.max(np.abs(sums / np.maximum(found, 1))[found > 500]):.3f}, "
              f"largest order at walls {np.max(np.abs(tilts / np.maximum(near, 1))[near > 500]):.3f}")
    pairs.set(xlabel="distance of centres / mean diameter", ylabel="pair correlation, grains below 4 mm")
    order.set(xlabel="distance of centres / mean diameter", ylabel="order of long axes, $P_2$")
    walls.set(xlabel="distance of centre from wall / diameter", ylabel="number density / mean")
    tilt.set(xlabel="distance of centre from wall / diameter", ylabel="order of short axes at the wall, $P_2$")
    for plot in (pairs, order, walls, tilt):
        plot.grid(alpha=0.3)
    pairs.legend()
    figure.savefig(out, dpi=90)


if __name__ == "__main__":
    main(*sys.argv[1:3], *map(int, sys.argv[3:4]))
