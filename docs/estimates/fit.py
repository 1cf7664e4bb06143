"""Fits the model of engine/src/plan/model.rs to the tables in data.json; needs numpy and scipy.

Run it from this folder: it prints the coefficients, and how far off they are on the studies left out
(`"fitted": false`). The features are computed here anew, so that a slip in one of the two shows.
"""
import heapq
import json
import math

import numpy as np
from scipy.optimize import least_squares

GAP = 0.7654


def classes(template):
    """(from, to, mass, exponent) of each class of the grading above d_min; mass ~ d**(exponent - 1)."""
    grading, least = template["mix"]["grading"], template["mix"].get("d_min_mm", 0.0)
    if grading["type"] == "fuller":
        return [(least, grading["d_max_mm"], 1.0, grading["exponent"])]
    if grading["type"] == "monodisperse":
        return [(grading["diameter_mm"], grading["diameter_mm"], 1.0, 0.0)]
    points = CURVES[grading["name"]]
    found = []
    for (a, pa), (b, pb) in zip(points, points[1:]):
        if b > least:
            low = max(a, least)
            found.append((low, b, (pb - pa) * math.log(b / low) / math.log(b / a), 0.0))
    return found


# DIN 1045-2: share of the mass that passes each sieve, linear in ln(d) between them.
CURVES = {
    "A8": [(0.25, 0.05), (0.5, 0.14), (1, 0.21), (2, 0.36), (4, 0.61), (8, 1.0)],
    "B8": [(0.25, 0.11), (0.5, 0.26), (1, 0.42), (2, 0.57), (4, 0.74), (8, 1.0)],
    "A16": [(0.25, 0.03), (0.5, 0.08), (1, 0.12), (2, 0.21), (4, 0.36), (8, 0.60), (16, 1.0)],
    "B16": [(0.25, 0.08), (0.5, 0.20), (1, 0.32), (2, 0.42), (4, 0.56), (8, 0.76), (16, 1.0)],
    "A32": [(0.25, 0.02), (0.5, 0.05), (1, 0.08), (2, 0.14), (4, 0.23), (8, 0.38), (16, 0.62), (31.5, 1.0)],
    "C32": [(0.25, 0.15), (0.5, 0.29), (1, 0.42), (2, 0.53), (4, 0.65), (8, 0.77), (16, 0.89), (31.5, 1.0)],
}


def sizes(template):
    """Diameters and their relative numbers."""
    d, number = [], []
    for low, high, mass, q in classes(template):
        if low == high:
            return np.array([low]), np.array([1.0])
        edges = np.geomspace(low, high, 401)
        middle = np.sqrt(edges[1:] * edges[:-1])
        share = np.diff(np.log(edges)) if q == 0 else np.diff(edges**q)
        d.append(middle)
        number.append(mass * share / share.sum() / middle**3)
    return np.concatenate(d), np.concatenate(number)


def random_close(d, number, rods=2000):
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


def features(template):
    d, number = sizes(template)
    coat = template.get("distance", {}).get("gap_mm", 0.0)
    specimen = template["specimen"]
    if specimen["type"] == "cylinder":
        volume = math.pi / 4 * specimen["diameter_mm"] ** 2 * specimen["height_mm"]
        walls = 4 / specimen["diameter_mm"] + 2 / specimen["height_mm"]
    else:
        volume = math.prod(specimen["size_mm"])
        walls = 0 if specimen.get("boundary") == "periodic" else sum(2 / x for x in specimen["size_mm"])
    bare, coated = (number * d**3).sum(), (number * (d + coat) ** 3).sum()
    grains = volume * number.sum() / (bare * math.pi / 6)
    d = d + coat
    moment = lambda k: (number * d**k).sum()
    share = number * d**3 / moment(3)
    mean = (share * np.log(d)).sum()
    spread = math.sqrt(max((share * np.log(d) ** 2).sum() - mean**2, 0))
    least = min(low for low, _, _, _ in classes(template)) + coat
    return dict(close=random_close(d, number), spread=spread, fines=mean - math.log(least),
                walls=walls * moment(3) / moment(2), coating=coated / bare, grains=grains,
                ratio=(max(high for _, high, _, _ in classes(template)) + coat) / least)


def rows(studies, method, fitted):
    for study in studies:
        if study["fitted"] == fitted:
            f = study["features"]
            for row in study["rows"]:
                if row["method"] == method:
                    yield f, row["volume_fraction"] * f["coating"], row["volume_fraction"] * f["grains"], row


def rsa_limits(studies, fitted):
    """The middle between the highest that all runs reached and the lowest that not all did."""
    for study in studies:
        if study["fitted"] != fitted:
            continue
        of = sorted((r["volume_fraction"], r["succeeded"] == r["runs"]) for r in study["rows"] if r["method"] == "rsa")
        reached = [phi for phi, all_did in of if all_did]
        not_reached = [phi for phi, all_did in of if not all_did]
        if reached and not_reached:
            yield study["features"], (max(reached) + min(not_reached)) / 2 * study["features"]["coating"]


def report(name, off):
    off = np.array(off)
    print(f"  {name}: rms {np.sqrt((off**2).mean()):.4f}, largest {np.abs(off).max():.4f} of {len(off)}")


def main():
    studies = json.load(open("data.json"))
    for study in studies:
        study["features"] = features(study["template"])

    print("random sequential addition: EQUAL, SPREAD, FINES, WALLS")
    row = lambda f: [1, -f["spread"], f["fines"], -f["walls"]]
    known = list(rsa_limits(studies, True))
    matrix = np.array([row(f) for f, _ in known])
    target = np.array([-math.log(1 - phi) for _, phi in known])
    x_limit = np.linalg.lstsq(matrix, target, rcond=None)[0]
    print(" ", x_limit.round(4))
    limit = lambda f: 1 - math.exp(-np.dot(row(f), x_limit))
    for fitted in (True, False):
        report(f"limit, {'fitted' if fitted else 'left out'}", [limit(f) - phi for f, phi in rsa_limits(studies, fitted)])

    def rsa_us(x, f, phi):
        crowding = min(phi / limit(f), 1)
        return math.exp(x[0]) + math.exp(x[1] + x[2] * (crowding - 1) + x[3] * f["spread"])

    def rsa_off(x, fitted):
        return [math.log(rsa_us(x, f, phi) / (r["time_s"] / n * 1e6) * max(n / 1e4, 1) ** 0.16)
                for f, phi, n, r in rows(studies, "rsa", fitted) if r.get("time_s", 0) > 0.003]

    x_time = least_squares(lambda x: rsa_off(x, True), [0, 4, 12, 2.3], loss="soft_l1").x
    print("  LOOSE_US, CROWDED_US, FALL_OFF, CROWDED_SPREAD", np.exp(x_time[:2]).round(2), x_time[2:].round(2))
    for fitted in (True, False):
        report(f"ln(time), {'fitted' if fitted else 'left out'}", rsa_off(x_time, fitted))

    def jamming(x, f, n):
        equal = math.exp(-((f["spread"] / 0.05) ** 2))
        return f["close"] * (x[3] - x[4] * f["walls"] - x[5] * f["walls"] ** 2 - x[6] * equal - x[7] * n ** (-1 / 3))

    def start(f, phi):
        """Where growth starts: `start` in model.rs, chosen by hand from measurements."""
        share = 0.75 + 0.9 * (phi / limit(f) - 0.867) + 0.107 * math.log(max(f["ratio"] / 8, 1))
        return min(limit(f) * min(max(share, 0.7), 0.88), 0.97**3 * phi)

    def ln_events(x, f, phi, n):
        share = min(phi / jamming(x, f, n), 0.99999)
        to_grow = 1 - start(f, phi) / phi
        return x[0] - x[1] * math.log(1 - share) + x[2] * math.log(share) + x[8] * math.log(to_grow)

    def growth_off(x, fitted):
        return [ln_events(x, f, phi, n) - math.log(r["events_per_grain"]) if r["succeeded"] == r["runs"]
                else min(0, ln_events(x, f, phi, n) - math.log(2000) + 0.3)
                for f, phi, n, r in rows(studies, "edmd", fitted) if r["succeeded"] in (0, r["runs"])]

    least = [-8, 1, -10, 1, 0, -0.05, 0, 0, 0]
    most = [8, 6, 40, 1.16, 0.3, 0.3, 0.2, 0.9, 4]
    x = least_squares(lambda x: growth_off(x, True), [0, 2.2, 4, 1.1, 0.08, 0, 0.04, 0.31, 2], loss="soft_l1",
                      bounds=(least, most)).x
    print("growth: EVENTS, -GAP, FILLED, BULK, -WALLS, -WALLS_SQUARED, -EQUAL, -FEW, TO_GROW")
    print(" ", x.round(4))
    for fitted in (True, False):
        report(f"ln(events), {'fitted' if fitted else 'left out'}", growth_off(x, fitted))

    def growth_time_off(y, fitted):
        return [math.log(n * (rsa_us(x_time, f, start(f, phi)) + math.exp(y[0]) + math.exp(y[1]) * r["events_per_grain"])
                         * 1e-6 / r["time_s"])
                for f, phi, n, r in rows(studies, "edmd", fitted) if r.get("time_s") and r["succeeded"]]

    y = least_squares(lambda y: growth_time_off(y, True), [2, 0], loss="soft_l1").x
    print("  START_US, EVENT_US", np.exp(y).round(2))
    for fitted in (True, False):
        report(f"ln(time), events known, {'fitted' if fitted else 'left out'}", growth_time_off(y, fitted))


main()
