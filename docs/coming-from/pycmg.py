"""Makes a request of a table of PyCMG: python pycmg.py TABLE.csv VOLUME_FRACTION X Y Z >job.json

Each row becomes an aggregate with the equivalent diameter, the ratios and the share of the row, as polyhedra of n_cuts
faces (at least 6). The columns a, b, c are read as full axes in mm; with the word `radii` at the end as semi-axes.
Coats, spaces and concave depressions are left out: see docs/coming-from/index.md.
"""

import csv
import json
import sys


def aggregate(row, scale):
    """The aggregate of a row."""
    long, middle, short = sorted((scale * float(row[axis]) for axis in "abc"), reverse=True)
    shape = {
        "type": "polyhedron",
        "template": "cuts",
        "faces": min(max(int(row["n_cuts"]), 6), 60),
        "template_count": 4,
        "ratios": {"type": "constant", "b_over_a": middle / long, "c_over_a": short / long},
    }
    diameter = round((long * middle * short) ** (1 / 3), 4)
    grading = {"type": "monodisperse", "diameter_mm": diameter}
    return {"share": float(row["vf_max"]), "grading": grading, "shape": shape}


def main():
    table, fraction, *edges = sys.argv[1:6]
    scale = 2 if sys.argv[6:] == ["radii"] else 1
    with open(table, newline="", encoding="utf-8-sig") as file:
        aggregates = [aggregate(row, scale) for row in csv.DictReader(file)]
    total = sum(one["share"] for one in aggregates)
    for number, one in enumerate(aggregates, 1):
        one.update(name=f"row {number}", share=one["share"] / total)
    mix = {"aggregates": aggregates, "volume_fraction": float(fraction), "size": "equivalent", "allow_coarse": True}
    json.dump({"seed": 1, "specimen": {"type": "box", "size_mm": [*map(float, edges)]}, "mix": mix}, sys.stdout, indent=2)


if __name__ == "__main__":
    main()
