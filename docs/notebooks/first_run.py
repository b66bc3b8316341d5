# %% [markdown]
# # A first run
#
# Plan, judge, drive and measure five robots in an office.

# %%
import mrp_sumo as ms

scenario = ms.Scenario(map="office", robots=5, planner="cbs", seed=3)
problem = ms.problem(scenario)
problem

# %% [markdown]
# The planner's answer, and what a referee that knows no planner says of it:

# %%
plan = ms.plan(problem)
print(ms.judge(problem, plan))
plan

# %% [markdown]
# Driven in SUMO. A moment of it as a picture:

# %%
run = ms.simulate(problem, plan)
run.plot(at_s=12)

# %% [markdown]
# Metrics, and tables of what happened:

# %%
names = ("goals_reached", "driven_makespan_s", "driven_flowtime_s", "min_clearance_m")
{name: run.metrics[name] for name in names}

# %%
run.visits.head()
