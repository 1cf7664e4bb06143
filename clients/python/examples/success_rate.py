# %% [markdown]
# # How much aggregate can be packed, and how long does it take?
#
# Packs the same mixes by random sequential addition (RSA) and by event-driven molecular dynamics (EDMD), at rising
# volume fractions and with several seeds each, and plots the success rate and the time per success.
#
# Needs a server (`packstone serve`) and `pip install "./clients/python[dataframe,plot]"`. The cells open as a notebook in
# editors that know `# %%`; `python success_rate.py` runs them all.

# %%
import matplotlib.pyplot as plt

import packstone

# The server of the environment variable PACKSTONE_URL, else the one of this machine.
client = packstone.Client()

# %% [markdown]
# ## The study
# What all packings have in common, and what varies: the pointers name fields of the job. Both methods get the same
# grains at a volume fraction, as the seeds depend on the mix alone.

# %%
job = {
    "specimen": {"type": "box", "size_mm": [50, 50, 50]},
    "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 4, "volume_fraction": 0.6},
    "distance": {"type": "constant", "gap_mm": 0.5},
    "method": {"type": "rsa"},
}
PHI, METHOD = "/mix/volume_fraction", "/method"
study = client.study(
    name="success rate of Fuller 4..16 mm",
    seed=1,
    template=job,
    grid={
        PHI: packstone.steps(0.50, 0.80, 0.05),
        METHOD: [
            {"type": "rsa", "attempts_per_grain": 1000},
            {"type": "edmd", "stop": {"time_s": 2}},
        ],
    },
    replicates=10,
)
print(study.id)  # client.open_study(...) finds it again, from another day or another machine

# %%
study.wait(progress=lambda seen: print(f"\r{seen.progress['fraction']:4.0%}", end="", flush=True))
print("\r" + str(study))

# %% [markdown]
# ## The table
# One row per point, with the 95 % interval of the success rate.

# %%
table = study.to_dataframe()
table["method"] = [method["type"] for method in table[METHOD]]
print(table[[PHI, "method", "grains", "runs", "successes", "success_rate", "time_s_per_success"]].to_string())

# %%
figure, (rate, time) = plt.subplots(2, 1, sharex=True, figsize=(6, 7), layout="constrained")
for method, rows in table.groupby("method"):
    below = rows["success_rate"] - rows["success_rate_low"]
    above = rows["success_rate_high"] - rows["success_rate"]
    rate.errorbar(rows[PHI], rows["success_rate"], yerr=[below, above], marker="o", capsize=3, label=str(method).upper())
    time.plot(rows[PHI], rows["time_s_per_success"], marker="o", label=str(method).upper())
rate.set_ylabel("success rate")
time.set_ylabel("time per success in s")
time.set_yscale("log")
time.set_xlabel("volume fraction of the aggregate")
rate.legend()
figure.savefig("success_rate.png", dpi=150)

# %% [markdown]
# ## The server's own plots
# Drawn without any of the above; a notebook shows them.

# %%
study.plot("success", "success.svg")
study.plot("time", "time.svg")

# %% [markdown]
# ## One of the packings
# The densest that was reached, as an array with the columns x, y, z and the diameter, in mm.

# %%
densest = max(study.jobs(state="succeeded"), key=lambda found: found.data["result"]["summary"]["volume_fraction_effective"])
spheres = densest.result().to_numpy()
print(f"{len(spheres)} grains; the largest has {spheres[0, 3]:.2f} mm and lies at {spheres[0, :3].round(2)} mm")
densest.result().save("densest.vtp")  # for ParaView
