"""The planners and assigners that come with mrp_sumo: name -> 'module:class', loaded on first use.

Other packages register a table like `PLUGINS` under the entry-point group `mrp_sumo.planners`.
"""

PLUGINS = {
    "planners": {
        "astar": "planners.astar:AStar",
        "prioritised": "planners.prioritised:Prioritised",
        "cbs": "planners.cbs:Cbs",
        "cbs_ta": "planners.cbs_ta:CbsTa",
        "ecbs": "planners.ecbs:Ecbs",
        "ecbs_ta": "planners.ecbs_ta:EcbsTa",
        "eecbs": "planners.eecbs:Eecbs",
        "external": "planners.external:External",
        "lacam": "planners.lacam:Lacam",
        "lns2": "planners.lns2:Lns2",
        "pibt": "planners.pibt:Pibt",
    },
    "assigners": {
        "cp_sat": "planners.cp_sat:CpSat",
        "linear_sum_assignment": "planners.linear_sum_assignment:LinearSumAssignment",
        "min_cost_flow": "planners.min_cost_flow:MinCostFlow",
        "mip": "planners.mip:Mip",
    },
}
