# %% [markdown]
# # A map of your own
#
# Any graph whose nodes have places is a map. A small hall with two aisles:

# %%
import networkx as nx

import mrp_sumo as ms

hall = nx.grid_2d_graph(4, 3)
for x, y in hall:
    name = f"{'abcd'[x]}{y + 1}"
    hall.nodes[x, y].update(x_m=2.0 * x, y_m=2.0 * y, name=name)
hall.remove_edges_from([((1, 0), (1, 1)), ((2, 1), (2, 2))])
lanes = ms.NavGraph.from_networkx(hall, name="hall")
site = ms.save_map(lanes, "hall.nav.yaml")
site.plot()

# %% [markdown]
# What the check of a map finds, if anything, with places:

# %%
site.findings

# %%
robots = {"starts": ["a1", "d3"], "goals": ["d1", "a3"]}
run = ms.run(ms.Scenario(map=site, robots=robots, planner="cbs"))
run.plot(at_s=10)
