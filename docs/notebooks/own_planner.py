# %% [markdown]
# # Write a planner
#
# A function that returns a path for each robot, a vertex a step. First without any care for others:

# %%
import networkx as nx

import mrp_sumo as ms

problem = ms.problem(ms.Scenario(map="office", robots=6, seed=5))


def everybody_straight(problem, time_limit_s):
    lanes = problem.graph.to_networkx()
    ends = zip(problem.start.tolist(), problem.target.tolist())
    return [nx.shortest_path(lanes, a, b) for a, b in ends]


print(ms.judge(problem, ms.plan(problem, everybody_straight)))

# %% [markdown]
# The referee names who meets whom. Better: those who come later leave out what is taken at each step.


# %%
def one_by_one(problem, time_limit_s):
    lanes, taken, paths = problem.graph.to_networkx(), set(), []
    horizon = 3 * problem.graph.num_vertices
    for start, goal in zip(problem.start.tolist(), problem.target.tolist()):
        front, before = [(start, 0)], {(start, 0): None}
        found = None
        while front and found is None:
            at, step = front.pop(0)
            if at == goal and all((goal, later) not in taken for later in range(step, horizon)):
                found = (at, step)
            for to in [at, *lanes.successors(at)]:
                new = (to, step + 1)
                free = new not in taken and ((to, step) not in taken or (at, step + 1) not in taken)
                if free and new not in before and step < horizon:
                    before[new] = (at, step)
                    front.append(new)
        path = []
        while found is not None:
            path.append(found[0])
            found = before[found]
        path = path[::-1] or [start]
        paths.append(path)
        taken |= {(v, k) for k, v in enumerate(path)} | {(path[-1], k) for k in range(len(path), horizon + 1)}
    return paths


plan = ms.plan(problem, one_by_one)
print(ms.judge(problem, plan))

# %% [markdown]
# Beside an optimal one:

# %%
best = ms.plan(problem, "cbs")
plan.cost_steps, best.cost_steps
