"""Jobs to submit, and what `packstone run` makes of the same: the bytes that the service must serve."""

import json
import subprocess
import threading

# Formats of results whose bytes depend on the request alone; the others contain times or the ID of the job.
PURE = ("npy", "csv", "view", "vtk")
# An export whose bytes depend on the request alone.
VOXELS = "voxels?format=raw&cells=24"
SEEDS = (1, 2)


def _box(edge_mm, boundary="walls"):
    return {"type": "box", "size_mm": [edge_mm] * 3, "boundary": boundary}


def _a16(volume_fraction, d_min_mm, **more):
    grading = {"type": "standard", "name": "A16"}
    return {"grading": grading, "d_min_mm": d_min_mm, "volume_fraction": volume_fraction, **more}


def _equal(grains, volume_fraction=0.25):
    edge_mm = (grains * 3.141592653589793 / 6 / volume_fraction) ** (1 / 3)
    mix = {"grading": {"type": "monodisperse", "diameter_mm": 1.0}, "volume_fraction": volume_fraction}
    return {"specimen": _box(edge_mm, "periodic"), "mix": mix}


GAP = {"type": "constant", "gap_mm": 0.2}
RATIOS = {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.65}
# Name, request without seed, and how often it is drawn.
KINDS = {
    "quick": ({"specimen": _box(40), "mix": _a16(0.40, 2.0), "distance": GAP}, 6),
    "equal": (_equal(2000), 3),
    "large": (_equal(20_000), 1),
    "growth": (
        {"specimen": _box(40), "mix": _a16(0.50, 4.0), "distance": {"type": "constant", "gap_mm": 0.5},
         "method": {"type": "edmd"}},
        2,
    ),
    "long": (
        {"specimen": _box(64), "mix": _a16(0.53, 2.0, volume_fraction_of="all_aggregate"),
         "distance": {"type": "constant", "gap_mm": 1.0}, "method": {"type": "edmd"}},
        1,
    ),
    "polyhedra": (
        {"specimen": _box(40),
         "mix": _a16(0.25, 4.0, shape={"type": "polyhedron", "template_count": 1})},
        1,
    ),
    "ellipsoids": (
        {"specimen": _box(40), "mix": _a16(0.30, 4.0, shape={"type": "ellipsoid", "ratios": RATIOS})},
        1,
    ),
}


def draw(random):
    """A kind and a seed."""
    names = list(KINDS)
    kind = random.choices(names, [KINDS[name][1] for name in names])[0]
    return kind, random.choice(SEEDS)


def body(kind, seed, label):
    """A job of this kind, to be found again by its label. Its attempts are not the concern of these tests."""
    return KINDS[kind][0] | {"seed": seed, "labels": {"order": label}, "max_attempts": 10, "threads": 1}


def study(kind, label):
    """A study of few jobs."""
    return {"template": KINDS[kind][0] | {"labels": {"study": label}, "max_attempts": 10, "threads": 1},
            "replicates": 3, "seed": 1}


class References:
    """Bytes that `packstone run` writes for each kind and seed, made in the background."""

    def __init__(self, binary, folder):
        self.binary, self.folder = binary, folder
        self.files = {}
        self.ready = threading.Event()
        self.fault = None

    def make(self):
        """Runs every kind with every seed."""
        for kind in KINDS:
            for seed in SEEDS:
                out = self.folder / f"{kind}-{seed}"
                out.mkdir(parents=True)
                job = out / "job.json"
                job.write_text(json.dumps(body(kind, seed, "reference")))
                command = [self.binary, "run", job, "--out", out, "--format", ",".join(PURE)]
                command += ["--export", "voxels:format=raw,cells=24"]
                ended = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
                if ended.returncode != 0:
                    self.fault = f"packstone run of {kind} ended with {ended.returncode}: {ended.stderr[-500:]}"
                    self.ready.set()
                    return
                for file in out.iterdir():
                    self.files[kind, seed, file.name] = file.read_bytes()
        self.ready.set()

    def bytes_of(self, kind, seed, what):
        """The bytes of a format or of the export; `None` while they are not there."""
        name = f"result.{what}" if what in PURE else None
        if name is None:
            names = [key[2] for key in list(self.files) if key[:2] == (kind, seed)]
            name = next((name for name in names if name.endswith(".raw") or "voxels" in name), None)
        return self.files.get((kind, seed, name))
