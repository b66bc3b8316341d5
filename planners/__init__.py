"""The planners and assigners that come with mrp_sumo: name -> 'module:class', loaded on first use.

Other packages register a table like `PLUGINS` under the entry-point group `mrp_sumo.plugins`.
"""

PLUGINS = {
    "planners": {
        "astar": "planners.astar:AStar",
        "auto": "planners.auto:Auto",
        "continuous": "planners.safe_interval.continuous:Continuous",
        "prioritised": "planners.safe_interval.prioritised:Prioritised",
        "cbs": "planners.conflict_based.cbs:Cbs",
        "ccbs": "planners.safe_interval.ccbs:Ccbs",
        "cbs_ta": "planners.conflict_based.cbs:CbsTa",
        "ecbs": "planners.conflict_based.ecbs:Ecbs",
        "ecbs_ta": "planners.conflict_based.ecbs:EcbsTa",
        "eecbs": "planners.conflict_based.eecbs:Eecbs",
        "external": "planners.external:External",
        "lacam": "planners.configuration.lacam:Lacam",
        "lns2": "planners.neighbourhood.lns2:Lns2",
        "pbs": "planners.safe_interval.pbs:Pbs",
        "pibt": "planners.configuration.pibt:Pibt",
        "plan_file": "planners.plan_file:PlanFile",
    },
    "step_planners": {
        "epibt": "planners.step_wise.epibt:Epibt",
        "program": "planners.step_wise.program:StepProgram",
    },
    "assigners": {
        "cp_sat": "planners.assigners.mip:CpSat",
        "linear_sum_assignment": "planners.assigners.linear_sum_assignment:LinearSumAssignment",
        "min_cost_flow": "planners.assigners.min_cost_flow:MinCostFlowAssigner",
        "mip": "planners.assigners.mip:Mip",
    },
}
