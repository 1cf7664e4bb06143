"""Effective conductivity of voxels by fast Fourier transforms: python fft.py VOXELS.npy MATRIX AGGREGATE

The basic scheme of Moulinec and Suquet (1998) for conduction in a periodic cell of cubic voxels.
"""

import sys

import numpy as np

labels = np.load(sys.argv[1])  # [x, y, z]: 0 matrix, 1 aggregate
conductivity = np.array([float(word) for word in sys.argv[2:4]])[labels]
reference = (conductivity.min() + conductivity.max()) / 2
frequencies = np.stack(np.meshgrid(*(np.fft.fftfreq(n) for n in labels.shape[:2]),
                                   np.fft.rfftfreq(labels.shape[2]), indexing="ij"))
# A frequency of half a cycle a voxel has no sign.
frequencies[np.abs(frequencies) == 0.5] = 0
square = (frequencies**2).sum(axis=0)
square[square == 0] = np.inf

mean = np.array([1.0, 0.0, 0.0])
gradient = np.broadcast_to(mean[:, None, None, None], (3, *labels.shape)).copy()
for iteration in range(200):
    flux = conductivity * gradient
    transformed = np.fft.rfftn(flux, axes=(1, 2, 3))
    divergence = (frequencies * transformed).sum(axis=0)
    step = np.fft.irfftn(frequencies * (divergence / square / reference), s=labels.shape, axes=(1, 2, 3))
    gradient -= step
    if np.sqrt((step**2).mean()) < 1e-6:
        break
flux = (conductivity * gradient).mean(axis=(1, 2, 3))
print(f"conductivity along x {flux[0]:.4f} W/(m K), {iteration + 1} iterations, aggregate {labels.mean():.4f}")
