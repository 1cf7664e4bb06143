"""Draws the stresses of docs/tutorial/calculix.md: python calculix_picture.py model.vtu OUT.png

model.vtu is what ccx2paraview made of model.frd. Needs the wheels pyvista and pillow.
"""

import sys
from typing import Any

import pyvista
from PIL import Image


def main(source: str, target: str) -> None:
    grid: Any = pyvista.read(source)
    grid["axial stress, MPa"] = grid["S"][:, 2]
    behind = grid.clip(normal="-y", origin=grid.center)
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[1200, 1000])
    plotter.background_color = "white"
    plotter.add_mesh(behind, scalars="axial stress, MPa", cmap="viridis_r", clim=(-5, -1.5), lighting=False,
                     scalar_bar_args={"color": "black", "vertical": True, "title_font_size": 24, "label_font_size": 22,
                                      "position_x": 0.8, "position_y": 0.2, "height": 0.6, "width": 0.08,
                                      "n_labels": 8, "fmt": "%.1f"})
    x, y, z = grid.center
    plotter.camera_position = [(x + 10, y - 60, z + 24), (x + 3, y, z + 1), (0, 0, 1)]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = 16.5
    pixels = plotter.screenshot(None, return_img=True)
    # Few colours keep the file small.
    Image.fromarray(pixels).quantize(160, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
