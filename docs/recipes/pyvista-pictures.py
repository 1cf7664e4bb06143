"""Four pictures of a packing with PyVista: python pyvista-pictures.py FOLDER"""

import sys
from pathlib import Path

import pyvista as pv

folder = Path(sys.argv[1])
pv.OFF_SCREEN = True


def save(name, *parts, camera=(1, 1, 1)):
    """Writes a picture of some meshes, each with its options, as seen from a direction."""
    plotter = pv.Plotter(window_size=(500, 460))
    plotter.background_color = "white"
    for mesh, how in parts:
        plotter.add_mesh(mesh, **how)
    plotter.view_vector(camera, viewup=(0, 0, 1))
    plotter.screenshot(folder / f"{name}.png")


# 1. The grains as spheres: points with a diameter each.
points = pv.read(folder / "result.vtp")
print(points.array_names)
spheres = points.glyph(geom=pv.Sphere(radius=0.5), scale="diameter", orient=False)
box = pv.Box((0, 30, 0, 30, 0, 30))
edges = {"style": "wireframe", "color": "black"}
save("grains", (spheres, {"scalars": "diameter", "smooth_shading": True}), (box, edges))

# 2. A cut through the voxels, and the aggregate behind it.
voxels = pv.read(folder / "result.cells-60.vti")
aggregate = voxels.threshold((1, 1), scalars="label").clip("x", origin=(15.1, 0, 0), invert=False)
cut = {"scalars": "label", "cmap": ["lightgrey", "tan"], "lighting": False, "show_scalar_bar": False}
save("voxels", (aggregate, {"color": "tan"}), (voxels.slice("x", origin=(15, 0, 0)), cut), camera=(-2, -1.2, 1))

# 3. Tetrahedra, cut open along elements, with their quality.
mesh = pv.read(next(folder.glob("*.vtu")))
matrix = mesh.threshold((0, 0), scalars="phase").clip("y", origin=(15, 15, 15), crinkle=True)
grains = mesh.threshold(0.5, scalars="phase")
save("mesh", (matrix, {"color": "lightgrey", "show_edges": True}), (grains, {"color": "tan"}))
quality = mesh.cell_quality("scaled_jacobian")["scaled_jacobian"]
print(f"{mesh.n_cells} tetrahedra, scaled Jacobian at least {quality.min():.3f}, mean {quality.mean():.3f}")

# 4. Numbers: volume of the phases.
sizes = mesh.compute_cell_sizes(length=False, area=False)["Volume"]
for phase, name in ((0, "matrix"), (1, "aggregate")):
    print(f"{name}: {sizes[mesh['phase'] == phase].sum():.2f} mm3")
