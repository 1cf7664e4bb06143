"""Measures the quality of packings, and prints the tables of docs/quality.md.

    python quality.py PACKSTONE [SEEDS]        PACKSTONE is the program; 5 seeds when absent

Packs Fuller 2..16 mm in a cube of 80 mm by random addition and by growth with and without swap moves, and 2000 equal
spheres as densely as they come, with walls and in a periodic box. Needs no other packages, and some two
minutes of a processor.
"""

import json
import math
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT_EVENTS = 20_000_000
SLOW_SEEDS = 3
EQUAL_SPHERES = 2000
RSA, SWAPS, NO_SWAPS = {"type": "rsa"}, {"type": "edmd"}, {"type": "edmd", "swap": False}


def fuller(volume_fraction, method):
    return {
        "specimen": {"type": "box", "size_mm": [80, 80, 80]},
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5},
            "d_min_mm": 2,
            "volume_fraction": volume_fraction,
            "volume_fraction_of": "placed_grains",
        },
        "method": method,
    }


def equal_spheres(boundary):
    """They start at 30 % and grow until they jam; the last digits make their number exact."""
    edge_mm = round((EQUAL_SPHERES * math.pi / 6 * 10**3 / 0.3) ** (1 / 3), 4)
    return {
        "specimen": {"type": "box", "size_mm": [edge_mm] * 3, "boundary": boundary},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 10}, "volume_fraction": 0.29997},
        "distance": {"type": "maximize"},
        "method": {"type": "edmd"},
    }


# The name of each packing, its request, and whether it takes long.
FULLER = [
    ("0.60, random addition", fuller(0.60, RSA), False),
    ("0.65, random addition", fuller(0.65, RSA), False),
    ("0.65, growth without swaps", fuller(0.65, NO_SWAPS), False),
    ("0.65, growth", fuller(0.65, SWAPS), False),
    ("0.68, growth without swaps", fuller(0.68, NO_SWAPS), False),
    ("0.68, growth", fuller(0.68, SWAPS), False),
    ("0.70, growth without swaps", fuller(0.70, NO_SWAPS), True),
    ("0.70, growth", fuller(0.70, SWAPS), False),
    ("0.73, growth without swaps", fuller(0.73, NO_SWAPS), True),
    ("0.73, growth", fuller(0.73, SWAPS), False),
]
EQUAL = [("walls", equal_spheres("walls"), True), ("periodic", equal_spheres("periodic"), True)]


def measured(program, job, seeds):
    """The quality reports and summaries of a job by seed; none where it is not packed within the limit."""
    job = json.loads(json.dumps(job))
    if job["method"]["type"] == "edmd":
        job["method"]["stop"] = {"events": LIMIT_EVENTS}
    found = []
    for seed in range(1, seeds + 1):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "job.json")
            path.write_text(json.dumps({"seed": seed, **job}))
            ended = subprocess.run([program, "run", path, "--out", folder, "--export", "quality"], capture_output=True)
            if ended.returncode != 0:
                if b"growth stopped" not in ended.stderr:
                    sys.exit(ended.stderr.decode())
                return []
            quality = json.loads(Path(folder, "result.quality.json").read_text())
            summary = json.loads(Path(folder, "result.json").read_text())["summary"]
            found.append((quality, summary))
    return found


def cell(values, digits):
    """Mean and standard deviation."""
    deviation = f" ({statistics.stdev(values):.{digits}f})" if len(values) > 1 else ""
    return f"{statistics.mean(values):.{digits}f}{deviation}"


def table(head, rows, columns):
    """Columns are lists of a function of the report and summary, and digits; several are joined by a slash."""
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for name, found in rows:
        if not found:
            print(f"| {name} | not reached in {LIMIT_EVENTS / 1e6:.0f} million events |" + " |" * (len(head) - 2))
            continue
        cells = [" / ".join(cell([of(*one) for one in found], digits) for of, digits in parts) for parts in columns]
        print(f"| {name} | " + " | ".join(cells) + " |")
    print()


def over_shuffled(finer, coarser):
    def ratio(quality, _):
        pairs = quality["contacts"]["by_class"]
        pair = next(pair for pair in pairs if (pair["finer"], pair["coarser"]) == (finer, coarser))
        return pair["share"] / pair["share_shuffled"]

    return ratio


def in_layers(first, last, size_class):
    """Volume fraction of a class in some layers together; the layer after the last is the core."""

    def fraction(quality, _):
        walls = quality["walls"]
        layers = [*walls["layers"], walls["core"]][first:last]
        volume = sum(layer["volume_fraction"][size_class] * layer["volume_mm3"] for layer in layers)
        return volume / sum(layer["volume_mm3"] for layer in layers)

    return fraction


def figure(part, name, factor=1):
    return lambda quality, _: factor * quality[part][name]


def main():
    program = str(Path(sys.argv[1]).resolve())
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    rows = [(name, measured(program, job, min(seeds, SLOW_SEEDS) if slow else seeds)) for name, job, slow in FULLER]
    table(
        ["packing", "median gap over `d_min`", "contacts a grain", "mark correlation", "like pairs in %", "shuffled"],
        rows,
        [
            [(figure("gaps", "median_excess"), 4)],
            [(figure("contacts", "contacts_per_grain"), 2)],
            [(figure("contacts", "mark_correlation"), 3)],
            [(figure("contacts", "like_share", 100), 1)],
            [(figure("contacts", "like_share_shuffled", 100), 1)],
        ],
    )
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    words = ["fine", "middle", "coarse"]
    table(
        ["near pairs over shuffled", *(f"{words[i]}, {words[j]}" for i, j in pairs)],
        rows,
        [[(over_shuffled(*pair), 2)] for pair in pairs],
    )
    layers = [(0, 1), (1, 2), (2, 6)]
    table(
        ["volume fraction: fine / middle / coarse", "outer 1 mm", "1 to 3 mm", "beyond 3 mm"],
        rows,
        [[(in_layers(*layer, size_class), 3) for size_class in range(3)] for layer in layers],
    )
    table(
        [
            "packing",
            "variation of fines / independent",
            "fine with coarse / independent",
            "Q6 / by chance",
            "solid-like in %",
        ],
        rows,
        [
            [(figure("blocks", "fine_variation"), 3), (figure("blocks", "fine_variation_independent"), 3)],
            [
                (figure("blocks", "fine_coarse_correlation"), 2),
                (figure("blocks", "fine_coarse_correlation_independent"), 2),
            ],
            [(figure("bond_order", "q6"), 3), (figure("bond_order", "q6_by_chance"), 3)],
            [(figure("bond_order", "solid_like_share", 100), 1)],
        ],
    )
    equal = [(name, measured(program, job, min(seeds, SLOW_SEEDS) if slow else seeds)) for name, job, slow in EQUAL]
    table(
        [
            f"{EQUAL_SPHERES} equal spheres",
            "volume fraction",
            "contacts a grain",
            "Q6 / by chance",
            "solid-like in %",
            "away from walls",
        ],
        equal,
        [
            [(lambda _, summary: summary["volume_fraction_with_coating"], 4)],
            [(figure("contacts", "contacts_per_grain"), 2)],
            [(figure("bond_order", "q6"), 3), (figure("bond_order", "q6_by_chance"), 3)],
            [(figure("bond_order", "solid_like_share", 100), 1)],
            [(figure("bond_order", "solid_like_share_away_from_walls", 100), 1)],
        ],
    )


main()
