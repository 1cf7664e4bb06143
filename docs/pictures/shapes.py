"""Renders the gallery of docs/shapes.md: one packing of each family of shapes, by the product's own renderer.

    python shapes.py OUT.png PACKSTONE

Needs the wheel `pillow`.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

from PIL import Image, ImageDraw, ImageFont

WIDTH, CAPTION, GAP = 440, 40, 10
TRIANGLE = {"type": "triangle", "k": 0.5}
FAMILIES = {
    "ellipsoids, triangle k = 0.4": {"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.4}},
    "ellipsoids, flakiness index 0.5": {"type": "ellipsoid", "ratios": {"type": "flakiness", "index": 0.5}},
    "polyhedra: cuts": {"type": "polyhedron", "faces": 24, "ratios": TRIANGLE},
    "polyhedra: cuts, rounding 0.12": {"type": "polyhedron", "faces": 24, "ratios": TRIANGLE, "rounding": 0.12},
    "polyhedra: deformed cuboids": {"type": "polyhedron", "template": "deformed_cuboid"},
    "polyhedra: Voronoi cells": {"type": "polyhedron", "template": "voronoi"},
}


def picture(binary: str, shape: dict) -> Image.Image:
    job = {
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 12, "exponent": 0.5}, "d_min_mm": 3, "volume_fraction": 0.5,
            "volume_fraction_of": "placed_grains", "allow_coarse": True, "shape": shape,
        },
        "method": {"type": "monte_carlo", "stop": {"time_s": 120}}, "seed": 3,
    }
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([binary, "run", "-", "--out", folder, "--picture"], input=json.dumps(job), text=True, check=True)
        with Image.open(pathlib.Path(folder) / "result.png") as found:
            image = found.convert("RGBA")
    white = Image.new("RGBA", image.size, (255, 255, 255, 255))
    white.alpha_composite(image)
    return white.convert("RGB").resize((WIDTH, WIDTH * image.height // image.width), Image.Resampling.LANCZOS)


def main(out: str, binary: str) -> None:
    pictures = [(caption, picture(binary, shape)) for caption, shape in FAMILIES.items()]
    height = pictures[0][1].height
    canvas = Image.new("RGB", (3 * (WIDTH + GAP) + GAP, 2 * (height + CAPTION) + GAP), "white")
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(20)
    for i, (caption, image) in enumerate(pictures):
        x, y = GAP + i % 3 * (WIDTH + GAP), GAP // 2 + i // 3 * (height + CAPTION)
        canvas.paste(image, (x, y))
        draw.text((x + WIDTH // 2, y + height + 4), caption, fill=(30, 30, 30), font=font, anchor="ma")
    canvas.save(out, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:3])
