"""Fits the reach of engine/src/plan/random.rs and model.rs to rows of measure.py; needs numpy and scipy.

    cargo run --release -p packstone-engine --features examples --example estimates < reach.jsonl > inputs.jsonl
    python fit.py inputs.jsonl

The example adds what the model sees of each mix. Reach and close packing are computed here anew, so that a slip in one
of the two shows.
"""
import heapq
import json
import sys

import numpy as np
from scipy.optimize import least_squares

GAP, EQUAL = 0.7654, 0.384


def from_coarse(values):
    """Sums over the grains that are at least as large."""
    return np.cumsum(values[::-1])[::-1]


def random_close(d, number, rods=1000):
    """Farr and Groot, J. Chem. Phys. 131, 244104 (2009)."""
    squares = np.concatenate([[0], np.cumsum(number * d * d)])
    count = np.concatenate([[0], np.cumsum(number)])
    below = (np.arange(rods) + 0.5) / rods * squares[-1]
    up_to = squares[1:] + d**2 * (count[-1] - count[1:])
    at = np.minimum(np.searchsorted(up_to, below), len(d) - 1)
    lengths = np.sort(np.sqrt(np.maximum((below - squares[at]) / (count[-1] - count[at]), 0)))[::-1]
    gaps = [-GAP * lengths[0]]
    for rod in lengths[1:]:
        widest = -heapq.heappop(gaps)
        heapq.heappush(gaps, -GAP * rod)
        heapq.heappush(gaps, -max(GAP * rod, widest - (1 + GAP) * rod))
    return lengths.sum() / (lengths.sum() - sum(gaps))


def rows():
    for line in open(sys.argv[1]):
        row = json.loads(line)
        reached = [run[0] for run in row["runs"] if run[1] == "succeeded"]
        missed = [run[0] for run in row["runs"] if run[1] != "succeeded"]
        if row["reach"] is None and reached and missed:
            row["reach"] = (max(reached) + min(missed)) / 2
        if not row["reach"]:
            continue
        d, number, surface, width = np.array(sorted(row["sizes"])).T
        shares = number * d**3 / (number * d**3).sum()
        row.update(d=d, number=number, shares=shares, grains=number.sum(), close=random_close(d, number),
                   walls_of_mean=row["walls"] / (shares / d).sum(),
                   form=np.log([(shares * surface).sum(), (shares * width).sum()]),
                   angular=float(row["request"]["mix"].get("shape", {}).get("type") == "polyhedron"))
        mean = (shares * np.log(d)).sum()
        row["spread"] = np.sqrt(max((shares * np.log(d) ** 2).sum() - mean**2, 0))
        yield row


def random(x, row, shape=(0, 0, 0, 0)):
    near, near_power, close_power, walls, few = x
    d, shares = row["d"], row["shares"]
    aspherical, surface, width, angular = shape
    g = np.exp((aspherical + angular * row["angular"]) * (1 - np.exp(-row["form"].sum() / 0.08))
               + row["form"] @ [surface, width])
    taken = from_coarse(shares) + g * (near * from_coarse(shares * d**-near_power) * d**near_power
                                       + (1 / EQUAL - 1 - near) * from_coarse(shares * d**-close_power) * d**close_power)
    left = np.maximum(0.3, 1 - walls * row["walls"] * d) * (1 - few / np.sqrt(np.maximum(1, from_coarse(row["number"]))))
    return (left / taken).min()


def growth(x, row, shape=(0, 0)):
    bulk, walls, equal, few = x
    share = bulk - walls * row["walls_of_mean"] - equal * np.exp(-((row["spread"] / 0.05) ** 2)) - few * row["grains"] ** (-1 / 3)
    form = row["form"].sum()
    return row["close"] * max(0.5, share) * np.exp(shape[0] * (1 - np.exp(-form / 0.08)) + shape[1] * form)


def fit(name, predict, start, of):
    off = lambda x: np.array([predict(x, row) - row["reach"] for row in of])
    found = least_squares(off, start, loss="soft_l1", f_scale=0.01)
    errors = np.quantile(abs(off(found.x)), [0.5, 0.9, 1]).round(4)
    print(f"{name}, {len(of)} mixes: {found.x.round(4)}, error {errors} (median, 90 %, most)")
    return found.x


def main():
    all_rows = list(rows())
    of = lambda what: [row for row in all_rows if row["what"] == what]
    x = fit("random addition: NEAR, NEAR_POWER, CLOSE_POWER, WALLS, FEW", random, [1.25, 1.2, 3.5, 0.16, 0.2], of("rsa"))
    fit("of shapes: ASPHERICAL, SURFACE, WIDTH, ANGULAR", lambda y, row: random(x, row, y), [-0.3, 0.3, 1.1, 0.2],
        of("shapes-rsa"))
    x = fit("growth, times REACH: BULK, -WALLS, -EQUAL, -FEW", growth, [1.08, 0.11, 0.06, 0.19], of("events"))
    fit("by moves: ASPHERICAL, SURFACE = WIDTH", lambda y, row: growth(x, row, y), [0.12, -0.33], of("moves"))


main()
