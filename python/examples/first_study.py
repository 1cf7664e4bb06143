"""A study without a server: its plot, and one of its packings saved and opened again."""

import matplotlib.pyplot as plt

import packstone

mix = packstone.Mix(packstone.Grading.fuller(16), 0.5, d_min_mm=4)
study = packstone.study(
    template={"specimen": packstone.Box(50), "mix": mix, "method": "rsa", "distance": 0.2},
    grid={"/mix/volume_fraction": [0.5, 0.6, 0.7, 0.8], "/distance/gap_mm": [0.2, 0.6, 1]},
    replicates=10,
    keep=True,
)
table = study.to_dataframe().pivot_table(index="volume_fraction", columns="gap_mm", values="success_rate")
figure, (rates, curve) = plt.subplots(2, figsize=(6, 9), layout="constrained")
table.plot(ax=rates, marker="o", ylabel="success rate")
densest = max(study.packings.values(), key=lambda packing: packing.volume_fraction)
packing = packstone.load(densest.save("densest.json"))
print(f"{packing}, the largest grain has {packing.diameters[0]:.2f} mm")
packing.plot(ax=curve)
figure.savefig("first_study.png")
