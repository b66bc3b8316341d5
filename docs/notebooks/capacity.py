# %% [markdown]
# # How many robots?
#
# By hand, to see what `mrp-sumo capacity` does with limits and far more care: throughput against the
# number of robots, with always work waiting.

# %%
import pandas as pd

import mrp_sumo as ms

base = ms.Scenario.read("warehouse_lifelong")
rows = []
for robots in (2, 6, 12):
    scenario = base.replace(
        robots={"count": robots, "draw": "anywhere"},
        tasks={"open": 2 * robots},
        execution={"engine": "kinematic", "time_limit_s": 600},
    )
    found = ms.run(scenario).metrics
    names = ("throughput_per_h", "lead_time_mean_s")
    rows.append({"robots": robots} | {name: found[name] for name in names})
table = pd.DataFrame(rows).set_index("robots")
table

# %%
table["throughput_per_h"].plot(marker="o", ylim=0, figsize=(6, 3))

# %% [markdown]
# One seed and ten minutes say little: `mrp-sumo capacity warehouse_lifelong --quick` repeats, leaves the warm-up out, finds knee, peak and
# collapse, and says what binds, in three minutes.
