# %% [markdown]
# # Delays and policies
#
# What random stops do to a plan,
# under a policy that keeps the plan's order (`adg`), and one that lets go whoever comes first (`open_loop`).

# %%
import pandas as pd

import mrp_sumo as ms

rows = []
for policy in ("adg", "open_loop"):
    for stops in (0.0, 0.02):
        for seed in (1, 2):
            execution = {
                "policy": policy,
                "engine": "kinematic",
                "disturbances": {"stops_per_s": stops},
            }
            scenario = ms.Scenario(map="office", robots=8, planner="lacam", seed=seed, execution=execution)
            run = ms.run(scenario)
            flowtime_s = run.metrics["driven_flowtime_s"]
            rows.append({"policy": policy, "stops_per_s": stops, "flowtime_s": flowtime_s})
pd.DataFrame(rows).pivot_table(index="policy", columns="stops_per_s", values="flowtime_s")

# %% [markdown]
# Who waited for whom in the last run:

# %%
events = run.events
events[events["kind"].isin(["waited", "blocked"])].head()
