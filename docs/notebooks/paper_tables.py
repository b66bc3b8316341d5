# %% [markdown]
# # The paper's tables, in small
#
# MRP-Bench's Table II asks how often planners find a plan, and how long they take. Three seeds instead of 54:

# %%
from pathlib import Path

import mrp_sumo as ms

Path("small.yaml").write_text("""\
base: office_9
until: plan
grid_search:
  planner: [astar, cbs, ecbs, eecbs]
  robots.count: [5, 9]
  seed: 3000..3002
""")
batch = ms.run_suite("small.yaml", workers=2)
batch.query("""select planner, "robots.count" as robots, count(*) as runs,
  round(100 * avg(coalesce(plan_valid, false)::int)) as valid_percent, round(1000 * avg(planning_time_s), 1) as mean_ms
from results group by all order by planner, robots""")

# %% [markdown]
# `astar` is the baseline in which robots ignore each other: its plans are found always and valid seldom. All of the paper's tables and
# figures, with the paper's numbers beside ours: [Our results](../paper.md).
