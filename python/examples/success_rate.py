# %% [markdown]
# # How much aggregate can be packed, and how long does it take?
#
# Packs the same mixes by random sequential addition (RSA) and by event-driven molecular dynamics (EDMD), at rising
# volume fractions and with several seeds each, and plots the success rate and the time per success.
#
# Needs a server (`packstone serve`) and `pip install "./python[dataframe,plot,progress]"`. The cells open as a
# notebook in editors that know `# %%`; `python success_rate.py` runs them all.

# %%
import matplotlib.pyplot as plt

import packstone

# The server of the environment variable PACKSTONE_URL, else the one of this machine.
client = packstone.Client()

# %% [markdown]
# ## The study
# The template is common to all packings. The pointers of the grid name the fields of the job that vary. At each volume
# fraction both methods pack the same grains, because the seeds depend on the mix alone.

# %%
job = {
    "specimen": packstone.Box(50),
    "mix": packstone.Mix(packstone.Grading.fuller(16), 0.6, d_min_mm=4),
    "distance": packstone.Distance.constant(0.5),
}
study = client.study(
    name="success rate of Fuller 4..16 mm",
    seed=1,
    template=job,
    grid={
        "/mix/volume_fraction": packstone.steps(0.50, 0.80, 0.05),
        "/method": [packstone.Method.rsa(attempts_per_grain=1000), packstone.Method.edmd(time_s=2)],
    },
    replicates=10,
)
print(study.id)  # client.open_study(...) finds it again, on another day or another machine

# %%
study.wait(progress=True)
print(study)

# %% [markdown]
# ## The table
# One row per point, with the 95 % interval of the success rate.

# %%
table = study.to_dataframe(labels={"method": {"rsa attempts_per_grain=1000": "RSA", 'edmd stop={"time_s":2}': "EDMD"}})
columns = ["volume_fraction", "method", "grains", "runs", "successes", "success_rate", "time_s_per_success"]
print(table[columns].to_string())
print(table.pivot_table(index="volume_fraction", columns="method", values="success_rate"))

# %%
figure, (rate, time) = plt.subplots(2, 1, sharex=True, figsize=(6, 7), layout="constrained")
for method, rows in table.groupby("method"):
    below = rows["success_rate"] - rows["success_rate_low"]
    above = rows["success_rate_high"] - rows["success_rate"]
    fraction = rows["volume_fraction"]
    rate.errorbar(fraction, rows["success_rate"], yerr=[below, above], marker="o", capsize=3, label=str(method))
    time.plot(fraction, rows["time_s_per_success"], marker="o", label=str(method))
rate.set_ylabel("success rate")
time.set_ylabel("time per success in s")
time.set_yscale("log")
time.set_xlabel("volume fraction of the aggregate")
rate.legend()
figure.savefig("success_rate.png", dpi=150)

# %% [markdown]
# ## Plots of the server
# The server draws the same plots without pandas and matplotlib. A notebook shows them.

# %%
study.plot("success", "success.svg")
study.plot("time", "time.svg")

# %% [markdown]
# ## The packings
# The table of runs has one row per packing. The densest one is read as arrays of positions and
# diameters, in mm, and saved for ParaView. `save_all` saves all packings, named by their values.

# %%
runs = study.runs_dataframe()
densest = client.job(runs.sort_values("volume_fraction_effective").dropna(subset=["grains"])["id"].iloc[-1]).result()
diameter_mm, at_mm = densest.diameters[0], densest.positions[0]
print(f"{len(densest)} grains; the largest has {diameter_mm:.2f} mm and lies at {at_mm.round(2)} mm")
densest.save("densest.vtp")
types = {"method": lambda method: method["type"]}
saved = study.save_all("packings", "npy", "{method}-{volume_fraction}-{seed}", labels=types)
print(f"{len(saved)} packings saved in the folder packings")
