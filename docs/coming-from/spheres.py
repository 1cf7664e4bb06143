"""A script as many write for Abaqus: spheres of 10 mm at random in a cube of 50 mm, written as a table."""

import csv
import random

EDGE, RADIUS, COUNT = 50, 5, 60

random.seed(1)
centres = []
while len(centres) < COUNT:
    new = [random.uniform(RADIUS, EDGE - RADIUS) for _ in range(3)]
    if all(sum((a - b) ** 2 for a, b in zip(new, old)) >= (2 * RADIUS) ** 2 for old in centres):
        centres.append(new)
with open("grains.csv", "w", newline="") as file:
    table = csv.writer(file)
    table.writerow(["x_mm", "y_mm", "z_mm", "d_mm"])
    table.writerows([*centre, 2 * RADIUS] for centre in centres)
