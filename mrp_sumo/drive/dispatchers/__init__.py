"""The dispatchers that come with mrp_sumo: name -> 'module:class', loaded on first use."""

ONE_SHOT = "one_shot"
NEAREST = "nearest"
OURS = {
    ONE_SHOT: "mrp_sumo.drive.dispatcher:OneShot",
    NEAREST: "mrp_sumo.drive.dispatchers.nearest:Nearest",
    "bundle": "mrp_sumo.drive.dispatchers.bundle:Bundle",
    "central": "mrp_sumo.drive.dispatchers.central:Central",
    "hungarian": "mrp_sumo.drive.dispatchers.hungarian:Hungarian",
    "min_cost_flow": "mrp_sumo.drive.dispatchers.min_cost_flow:MinCostFlow",
    "regret": "mrp_sumo.drive.dispatchers.regret:Regret",
    "round_robin": "mrp_sumo.drive.dispatchers.round_robin:RoundRobin",
    "token_passing": "mrp_sumo.drive.dispatchers.token_passing:TokenPassing",
    "tpts": "mrp_sumo.drive.dispatchers.tpts:Tpts",
}
