"""Conductivity of a mesh along z with FEniCSx: python fenicsx.py MESH.msh MATRIX AGGREGATE EDGE"""

import sys

import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import LinearProblem
from dolfinx.io import gmshio
from mpi4py import MPI
from petsc4py.PETSc import ScalarType

path, edge = sys.argv[1], float(sys.argv[4])
gmsh.initialize(["gmsh", "-v", "2"])
gmsh.open(path)
mesh, phases = gmshio.model_to_mesh(gmsh.model, MPI.COMM_WORLD, 0, gdim=3)[:2]
functionspace = getattr(fem, "functionspace", None) or fem.FunctionSpace  # by its name from 0.7 on

# The groups of the mesh: 1 is the matrix, 2 the aggregates.
conductivity = fem.Function(functionspace(mesh, ("DG", 0)))
for group, value in zip((1, 2), map(float, sys.argv[2:4])):
    conductivity.x.array[phases.find(group)] = value

space = functionspace(mesh, ("CG", 2))
faces = [fem.locate_dofs_geometrical(space, lambda x, z=z: np.isclose(x[2], z)) for z in (0.0, edge)]
conditions = [fem.dirichletbc(ScalarType(value), dofs, space) for value, dofs in zip((0, edge), faces)]
u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
zero = fem.Constant(mesh, ScalarType(0))
problem = LinearProblem(conductivity * ufl.dot(ufl.grad(u), ufl.grad(v)) * ufl.dx, zero * v * ufl.dx, bcs=conditions,
                        petsc_options={"ksp_type": "cg", "pc_type": "gamg", "ksp_rtol": 1e-10})
temperature = problem.solve()



def integral(integrand):
    """The integral over the mesh."""
    return mesh.comm.allreduce(fem.assemble_scalar(fem.form(integrand * ufl.dx)), MPI.SUM)


volume = integral(fem.Constant(mesh, ScalarType(1)))
print(f"volume {volume:.4f} mm3, conductivity along z {integral(conductivity * temperature.dx(2)) / volume:.5f} W/(m K)")
