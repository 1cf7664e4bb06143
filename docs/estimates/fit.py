"""Fits the model of engine/src/plan/{random,model}.rs to what was measured; needs numpy and scipy.

    python fit.py rows [FOLDER] > rows.jsonl
    cargo run --release -p packstone-engine --features examples --example estimates < rows.jsonl > inputs.jsonl
    python fit.py fit inputs.jsonl

The first prints the rows of reach.jsonl, the studies of data.json, and what `packstone bench --only forecast --resume
FOLDER` has recorded. The example adds what the model sees of each request. Reach, close packing and events are computed
here anew, so that a slip in one of the two shows.
"""
import heapq
import json
import math
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

HERE = Path(__file__).parent
GAP, EQUAL = 0.7654, 0.384
# Most events per grain of runs that succeed, the standard error of ln(events), and the quantile of nine in ten.
LAST_SUCCESS, ERROR, NINE_OF_TEN = 2000, 0.4, 1.28155


def rows():
    """What was measured, a row for each mix."""
    yield from map(json.loads, (HERE / "reach.jsonl").open())
    for study in json.loads((HERE / "data.json").read_text()):
        events = [row for row in study["rows"] if row["method"] == "edmd"]
        added = [(row["volume_fraction"], row["succeeded"] == row["runs"])
                 for row in study["rows"] if row["method"] == "rsa"]
        yield dict(what="study", request=study["template"], fitted=study["fitted"], rows=events, added=added)
    for file in Path(sys.argv[2]).glob("*.json") if len(sys.argv) > 2 else []:
        record = json.loads(file.read_text())
        if not record["request"]:
            continue
        is_shaped = "shape" in record["request"]["mix"]
        names = ["shapes-rsa", "moves"] if is_shaped else ["rsa", "events"]
        for method, what in zip(["rsa", "growth"], names):
            if record[method] and record[method][1] - record[method][0] < 0.016 and not is_cut(record, record[method]):
                yield dict(what=what, request=record["request"], reach=sum(record[method]) / 2)


def is_cut(record, bracket):
    """Whether the time of a run, and not the grains, ended a run at the upper end of a bracket."""
    ends = [run["end"] for run in record["runs"] if run["filled"] == bracket[1] and run["purpose"] == "reach"]
    return "cut" in ends


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


def shapes(row):
    """The shapes of a request with their shares."""
    shape = row["request"]["mix"].get("shape", {"type": "sphere"})
    return [(part["share"], part["shape"]) for part in shape["of"]] if "of" in shape else [(1, shape)]


def with_features(row):
    """Adds what the formulas need of the sizes."""
    inputs = row["inputs"]
    d, number, surface, width = np.array(sorted(inputs["sizes"])).T
    shares = number * d**3 / (number * d**3).sum()
    mean = (shares * np.log(d)).sum()
    spread = math.sqrt(max((shares * np.log(d) ** 2).sum() - mean**2, 0))
    least, most = inputs["bounds"]
    gap = row["request"].get("distance", {}).get("gap_mm", 0)
    row.update(d=d, number=number, shares=shares, grains=number.sum(), close=random_close(d, number), spread=spread,
               walls=inputs["walls"], walls_of_mean=inputs["walls"] / (shares / d).sum(), ratio=most / least,
               coating=(number * d**3).sum() / (number * (d - gap) ** 3).sum(),
               form=np.log([(shares * surface).sum(), (shares * width).sum()]),
               angular=sum(share for share, shape in shapes(row) if shape["type"] == "polyhedron"),
               cuboid=sum(share * (1 - 2 * shape.get("rounding", 0)) for share, shape in shapes(row)
                          if shape.get("template") == "cube"))
    # The limit of random addition by which growth starts, `start` in model.rs.
    fines = mean - math.log(least)
    row["limit"] = 1 - math.exp(-(0.5195 - 0.688 * spread + 0.9128 * fines - 0.1216 * row["walls_of_mean"]))
    return row


def random(x, row, shape=(0, 0, 0, 0)):
    near, near_power, close_power, walls, few = x
    d, shares = row["d"], row["shares"]
    aspherical, surface, width, angular = shape
    g = np.exp((aspherical + angular * row["angular"]) * (1 - np.exp(-row["form"].sum() / 0.08))
               + row["form"] @ [surface, width])
    fall_off = lambda power: from_coarse(shares * d**-power) * d**power
    taken = from_coarse(shares) + g * (near * fall_off(near_power) + (1 / EQUAL - 1 - near) * fall_off(close_power))
    few_of = few / np.sqrt(np.maximum(1, from_coarse(row["number"])))
    return (np.maximum(0.3, 1 - walls * row["walls"] * d) * (1 - few_of) / taken).min()


def jamming(x, row, grains):
    bulk, walls, equal, few, very_few = x
    equal *= math.exp(-((row["spread"] / 0.05) ** 2))
    of_dozens = max(0.5, bulk - walls * row["walls_of_mean"] - equal - few * grains ** (-1 / 3))
    return row["close"] * max(0.3, of_dozens - very_few / grains)


def ln_events(x, row, filled, grains):
    """Of the events per grain to a volume fraction with coating."""
    at, gap, full, to_grow = x[:4]
    share = min(filled / jamming(x[4:], row, grains), 0.99999)
    by_target = 0.9 * (filled / row["limit"] - 0.867)
    start = min(max(0.75 + by_target + 0.107 * math.log(max(row["ratio"] / 8, 1)), 0.7), 0.88)
    start = min(row["limit"] * start, 0.97**3 * filled)
    return at - gap * math.log(1 - share) + full * math.log(share) + to_grow * math.log(1 - start / filled)


def reach_by_events(x, row):
    """The volume fraction that nine of ten runs of growth reach."""
    high = jamming(x[4:], row, row["grains"])
    low = 0.5 * high
    for _ in range(40):
        middle = (low + high) / 2
        is_reached = ln_events(x, row, middle, row["grains"]) < math.log(LAST_SUCCESS) - NINE_OF_TEN * ERROR
        low, high = (middle, high) if is_reached else (low, middle)
    return low


def off_events(x, studies):
    """ln of the events of studies over those counted; of runs that all failed, what is forecast below the most."""
    for study in studies:
        for row in study["rows"]:
            phi = row["volume_fraction"]
            grains = study["grains"] * phi / study["request"]["mix"]["volume_fraction"]
            if row["succeeded"] in (0, row["runs"]):
                forecast = ln_events(x, study, phi * study["coating"], grains)
                yield (forecast - math.log(row["events_per_grain"]) if row["succeeded"]
                       else min(0, forecast - math.log(LAST_SUCCESS) + 0.3))


def fit(name, off, start):
    x = least_squares(off, start, loss="soft_l1", f_scale=0.01).x
    return told(name, x, off(x))


def told(name, x, off):
    errors = np.quantile(abs(np.array(off)), [0.5, 0.9, 1]).round(4)
    print(f"{name}: {x.round(4).tolist()}, error {errors} (median, 90 %, most) of {len(off)}")
    return x


def main():
    measured = [with_features(json.loads(line)) for line in open(sys.argv[2])]
    studies = [row for row in measured if row["what"] == "study"]
    for study in studies:
        all_did, some_failed = ([phi for phi, did in study["added"] if did == all_of] for all_of in (True, False))
        if all_did and some_failed:
            reach = (max(all_did) + min(some_failed)) / 2 * study["coating"]
            grains = study["grains"] / study["request"]["mix"]["volume_fraction"] * reach / study["coating"]
            number = study["number"] * grains / study["grains"]
            measured.append({**study, "what": "rsa", "reach": reach, "number": number})
    for row in measured:
        if row.get("reach") is None and row["what"] != "study":
            reached = [run[0] for run in row["runs"] if run[1] == "succeeded"]
            missed = [run[0] for run in row["runs"] if run[1] != "succeeded"]
            row["reach"] = (max(reached) + min(missed)) / 2 if reached and missed else None
    # What a few long grains reach is scatter.
    is_usable = lambda row: row["reach"] and (row["what"] != "shapes-rsa" or row["grains"] > 60)
    of = lambda what: [row for row in measured if row["what"] == what and is_usable(row)]
    error = lambda predict, what: lambda x: np.array([predict(x, row) - row["reach"] for row in of(what)])

    x = fit("random addition: NEAR, NEAR_POWER, CLOSE_POWER, WALLS, FEW", error(random, "rsa"),
            [1.25, 1.2, 3.5, 0.16, 0.2])
    fit("of shapes: ASPHERICAL, SURFACE, WIDTH, ANGULAR", error(lambda y, row: random(x, row, y), "shapes-rsa"),
        [-0.3, 0.3, 1.1, 0.2])

    # Events and reach of growth share the volume fraction of jamming. 0.01 of reach weighs as 0.6 of ln(events).
    by_events = error(reach_by_events, "events")
    of_fit = [study for study in studies if study["fitted"]]
    of_many = lambda x: np.append(x, 0)
    both = lambda x: np.concatenate([list(off_events(of_many(x), of_fit)), 60 * by_events(of_many(x))])
    x = of_many(least_squares(both, [2, 2, 2, 1.6, 1.1, 0.11, 0.03, 0.15], loss="soft_l1").x)
    of_few = error(reach_by_events, "few-events")
    x[-1:] = fit("growth of few grains: -VERY_FEW", lambda very_few: of_few([*x[:-1], *very_few]), [0.5])
    name = "growth: EVENTS, -GAP, FILLED, TO_GROW, BULK, -WALLS, -EQUAL, -FEW, -VERY_FEW"
    told(name + ": reach", x, by_events(x))
    for fitted in (True, False):
        of_studies = list(off_events(x, [study for study in studies if study["fitted"] == fitted]))
        told(f"  ln(events), studies {'fitted' if fitted else 'for tests'}", x, of_studies)
    share = [reach_by_events(x, row) / jamming(x[4:], row, row["grains"]) for row in of("events")]
    print(f"  REACH: {np.mean(share):.3f}")

    def moves(y, row):
        aspherical, surface, width, angular, cuboid, few = y
        by_form = aspherical + few * max(row["grains"], 22) ** (-1 / 3)
        by_form *= 1 - math.exp(-row["form"].sum() / 0.08)
        by_form += row["form"] @ [surface, width] + angular * row["angular"] + cuboid * row["cuboid"]
        return np.mean(share) * jamming([*x[4:-1], 0], row, row["grains"]) * math.exp(by_form)

    fit("by moves: ASPHERICAL, SURFACE, WIDTH, ANGULAR, CUBOID, FEW", error(moves, "moves"),
        [0.05, -0.2, -0.3, -0.04, 0.13, 0.25])


if sys.argv[1:2] == ["rows"]:
    for row in rows():
        print(json.dumps(row))
else:
    main()
