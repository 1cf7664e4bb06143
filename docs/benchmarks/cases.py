"""The cases of BENCHMARKS.md: what the other codes needed, and the jobs that repeat ours."""

FULLER = {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}
ELLIPSOIDS = {"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 1 / 1.5}}
ROUND = {"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.64}}


def walls(fraction):
    """Spheres by Fuller's curve from 2 to 16 mm in a cube of 80 mm with walls."""
    mix = {"grading": FULLER, "d_min_mm": 2, "volume_fraction": fraction, "volume_fraction_of": "placed_grains"}
    return {"specimen": {"type": "box", "size_mm": [80, 80, 80]}, "mix": mix, "method": {"type": "edmd"}}


def shaped(fraction, shape):
    """The same curve with grains of another shape, in a periodic cube."""
    job = walls(fraction)
    job["specimen"]["boundary"] = "periodic"
    job["mix"]["shape"] = shape
    job["method"] = {"type": "monte_carlo"}
    return job


def equal(count, fraction, shape=None):
    """Equal grains with the volume of spheres of 5 mm, in a periodic cube."""
    edge = (count * 5**3 * 3.141592653589793 / 6 / fraction) ** (1 / 3)
    mix = {"grading": {"type": "monodisperse", "diameter_mm": 5}, "count": count, "size": "equivalent"}
    if shape:
        mix["shape"] = shape
    return {
        "specimen": {"type": "box", "size_mm": [edge] * 3, "boundary": "periodic"},
        "mix": mix,
        "method": {"type": "monte_carlo" if shape else "edmd"},
    }


def solid(name):
    """A Platonic solid."""
    return {"type": "polyhedron", "template": name}


# Case, our CPU seconds, the other code, its CPU seconds, and the job. The seconds are those of commit eb77727
# (2026-11-26); None where the other code had not reached the volume fraction when it was stopped.
CASES = [
    ("graded spheres, walls, 0.60", 0.12, "NuTo", 1.46, walls(0.60)),
    ("graded spheres, walls, 0.65", 0.20, "NuTo", 4.02, walls(0.65)),
    ("graded spheres, walls, 0.70", 0.67, "NuTo", None, walls(0.70)),
    ("graded ellipsoids, periodic, 0.55", 0.36, "HOOMD-blue", None, shaped(0.55, ELLIPSOIDS)),
    ("graded ellipsoids, periodic, 0.70", 1.25, "HOOMD-blue", None, shaped(0.70, ELLIPSOIDS)),
    ("1000 equal ellipsoids, 0.68", 1.6, "HOOMD-blue", 14, equal(1000, 0.68, ROUND)),
    ("1000 equal ellipsoids, 0.71", 3.7, "HOOMD-blue", 36, equal(1000, 0.71, ROUND)),
    ("400 cubes, 0.65", 7.5, "HOOMD-blue", 13.3, equal(400, 0.65, solid("cube"))),
    ("400 cubes, 0.66", 16.5, "HOOMD-blue", 16.4, equal(400, 0.66, solid("cube"))),
    ("400 octahedra, 0.64", 9.2, "HOOMD-blue", 16.6, equal(400, 0.64, solid("octahedron"))),
    ("400 tetrahedra, 0.55", 7.8, "HOOMD-blue", 14, equal(400, 0.55, solid("tetrahedron"))),
    ("400 tetrahedra, 0.59", 52.7, "HOOMD-blue", 34, equal(400, 0.59, solid("tetrahedron"))),
    ("2000 equal spheres, 0.636", 0.4, "packing-generation", 3.0, equal(2000, 0.636)),
    ("2000 equal spheres, 0.6385", 1.0, "packing-generation", 4.2, equal(2000, 0.6385)),
]
