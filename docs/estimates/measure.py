"""Measures what the model of engine/src/plan is fitted to: python measure.py PACKSTONE WHAT SEED COUNT > rows.jsonl

WHAT is rsa, events, shapes-rsa or moves. Each row has a request and the volume fraction with coating that it reaches.
"""
import json, math, random, subprocess, sys, tempfile

PACKSTONE, WHAT, SEED, COUNT = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
rng = random.Random(f"{WHAT}{SEED}")
log_between = lambda a, b: math.exp(rng.uniform(math.log(a), math.log(b)))

def grading():
    kind = rng.choice(["fuller", "standard", "single", "narrow", "gap", "sieves", "list"])
    if kind == "fuller":
        top = 16.0
        return dict(type="fuller", d_max_mm=top, exponent=round(rng.uniform(0.25, 0.9), 3)), round(top / log_between(1.5, 24), 3), top
    if kind == "standard":
        name, top = rng.choice([("A8", 8), ("B8", 8), ("C8", 8), ("A16", 16), ("B16", 16), ("C16", 16), ("A32", 31.5), ("B32", 31.5), ("C32", 31.5)])
        return dict(type="standard", name=name), round(top / log_between(1.5, 20), 3), top
    if kind == "single":
        return dict(type="monodisperse", diameter_mm=4.0), 4.0, 4.0
    if kind == "narrow":
        top = round(4 * rng.uniform(1.1, 2.5), 3)
        return dict(type="sieves", points=[[4, 0], [top, 1]]), 4.0, top
    if kind == "gap":
        a = round(2 * rng.uniform(1.2, 2), 3); b = round(a * rng.uniform(1.5, 4), 3); c = round(b * rng.uniform(1.1, 2), 3)
        share = round(rng.uniform(0.1, 0.6), 3)
        return dict(type="sieves", points=[[2, 0], [a, share], [b, share], [c, 1]]), 2.0, c
    if kind == "sieves":
        n = rng.choice([3, 4]); top = 2.0 ** n
        cuts = sorted(rng.random() for _ in range(n - 1))
        points = [[1.0, 0.0]] + [[2.0 ** (i + 1), round(c, 3)] for i, c in enumerate(cuts)] + [[top, 1.0]]
        return dict(type="sieves", points=points), 1.0, top
    return None, 0.0, 0.0

def specimen(edge):
    u = rng.random()
    if u < 0.35: return dict(type="box", size_mm=[edge] * 3)
    if u < 0.5: return dict(type="box", size_mm=[edge * 1.6, edge * 1.6, edge * 0.4])
    if u < 0.7: return dict(type="cylinder", diameter_mm=edge * 0.86, height_mm=edge * 1.72)
    return dict(type="box", size_mm=[edge] * 3, boundary="periodic")

def shape():
    c = round(10 ** -rng.random(), 3); b = round(rng.uniform(c, 1), 3)
    ratios = dict(type="constant", b_over_a=b, c_over_a=c) if rng.random() < 0.8 else dict(type="triangle", k=c)
    if rng.random() < 0.5: return dict(type="ellipsoid", ratios=ratios)
    template = rng.choice(["cuts", "cuts", "voronoi", "cube", "octahedron", "tetrahedron"])
    s = dict(type="polyhedron", template=template, ratios=ratios, rounding=0 if rng.random() < 0.7 else round(rng.uniform(0.02, 0.3), 3))
    if template == "cuts": s["faces"] = rng.randint(6, 60)
    return s

def plan(request):
    with tempfile.NamedTemporaryFile("w", suffix=".json") as f:
        json.dump(request, f); f.flush()
        done = subprocess.run([PACKSTONE, "plan", f.name], capture_output=True, text=True)
    return json.loads(done.stdout) if done.returncode == 0 else None

def scaled(spec, k):
    return {key: ([x * k for x in v] if isinstance(v, list) else v * k if isinstance(v, float) else v) for key, v in spec.items()}

def run(request, seed, most):
    done = subprocess.run([PACKSTONE, "bench", "--packing"], input=json.dumps(dict(request=request, seed=seed, most_cpu_s=most)),
                          capture_output=True, text=True)
    return json.loads(done.stdout) if done.returncode == 0 else dict(end="refused", cpu_s=0, operations=0, reached=None, peak_mb=0)

def draw():
    most = {"rsa": 1200, "events": 500, "shapes-rsa": 250, "moves": 400}[WHAT]
    while True:
        g, low, high = grading()
        n = log_between(20 if WHAT in ("rsa", "events") else 100, most)
        spec = specimen(1.0)
        request = dict(specimen=spec, mix=dict(allow_coarse=True))
        if g is None:
            sigma = rng.uniform(0.03, 0.5)
            d = [round(4 * math.exp(sigma * max(-2.5, min(2.5, rng.gauss(0, 1)))), 3) for _ in range(int(n))]
            low, high = min(d), max(d)
            volume = sum(x ** 3 for x in d) * math.pi / 6
            shares = spec["size_mm"][0] * spec["size_mm"][1] * spec["size_mm"][2] if "size_mm" in spec else math.pi / 4 * spec["diameter_mm"] ** 2 * spec["height_mm"]
            request["mix"]["grading"] = dict(type="diameters", diameters_mm=d)
            request["specimen"] = scaled(spec, (volume / 0.5 / shares) ** (1 / 3))
        else:
            request["mix"].update(grading=g, d_min_mm=low, volume_fraction=0.5, volume_fraction_of="placed_grains")
            request["specimen"] = scaled(spec, 6 * high)
            p = plan(request)
            if p is None: continue
            request["specimen"] = scaled(request["specimen"], (n / p["grains"]) ** (1 / 3))
        edges = request["specimen"].get("size_mm") or [request["specimen"]["diameter_mm"], request["specimen"]["height_mm"]]
        if min(edges) < 1.6 * high: continue
        if rng.random() < 0.4: request["distance"] = dict(type="constant", gap_mm=round(rng.random() * low, 3))
        if WHAT in ("shapes-rsa", "moves"):
            request["mix"].update(shape=shape(), size="equivalent")
        return request

def at(request, fraction, method):
    request = json.loads(json.dumps(request))
    if "volume_fraction" in request["mix"]: request["mix"]["volume_fraction"] = fraction
    else: request["specimen"] = scaled(request["specimen"], (0.5 / fraction) ** (1 / 3))
    request["method"] = dict(type=method)
    return request

for number in range(COUNT):
    request = draw()
    p = plan(at(request, 0.1, "auto"))
    if p is None: continue
    coating = p["volume_fraction_with_coating"] / p["volume_fraction_effective"]
    method = {"rsa": "rsa", "events": "edmd", "shapes-rsa": "rsa", "moves": "monte_carlo"}[WHAT]
    runs = []
    def one(filled, seed, most):
        out = run(at(request, min(filled / coating, 0.99), method), seed, most)
        runs.append([round(filled, 4), out["end"], round(out["cpu_s"], 4), out["operations"], out["reached"]])
        return out
    reach = None
    if method != "edmd":
        most, k, width = {"rsa": (3, 4, 0.004), "shapes-rsa": (2, 2, 0.012), "moves": (6, 1, 0.012)}[WHAT]
        guess = p["methods"]["rsa" if method == "rsa" else "growth"]["volume_fraction_with_coating_reach"]
        low, high, f, step, seed = None, None, guess * (1 if WHAT == "rsa" else 0.75 if WHAT == "shapes-rsa" else 0.9), 0.05, 0
        for level in range(14):
            ok = True
            for i in range(k):
                seed += 1
                ok = one(f, seed, most)["end"] == "succeeded"
                if not ok: break
            if ok: low = f
            else: high = f
            if low is not None and high is not None:
                if high - low < width: break
                f = (low + high) / 2
            else:
                f += step if ok else -step
            if f <= 0.02: break
        if low is not None and high is not None: reach = (low + high) / 2
    else:
        # Grains that jam below a target say how far they grow.
        f = p["methods"]["growth"]["volume_fraction_with_coating_reach"] * 1.06
        jams = []
        for i in range(6):
            out = one(f, i + 1, 12)
            if out["end"] == "succeeded": f = min(f * 1.03, 0.99 * coating)
            elif out["end"] == "refused": break
            elif out["reached"] is not None:
                jams.append(out["reached"] * f)
                f = min(f, jams[-1] * 1.02)
            else: f -= 0.02
            if len(jams) >= 2: break
        if jams: reach = min(jams)
    print(json.dumps(dict(what=WHAT, request=at(request, (reach or 0.5) / coating, method), coating=coating, grains=p["grains"] / 0.1 * (reach or 0.5) / coating if request["mix"].get("volume_fraction") else p["grains"], reach=reach, runs=runs)), flush=True)
