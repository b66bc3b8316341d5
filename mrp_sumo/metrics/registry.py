"""All bundled metrics, in the order of `result.json` and of the columns of results.

Documentation, reports, comparisons and batches read this table; a metric's unit, sense and formula stand nowhere else.
"""

from mrp_sumo.metrics import motion, mrp_bench, planning, safety, service, tasks
from mrp_sumo.metrics.metric import YES_NO, Metric

METRICS: tuple[Metric, ...] = (
    service.num_robots,
    mrp_bench.plan_success,
    planning.plan_valid,
    planning.num_vertex_conflicts,
    planning.num_edge_conflicts,
    planning.num_following_conflicts,
    planning.planning_time_s,
    planning.prepare_time_s,
    mrp_bench.makespan_steps,
    mrp_bench.cost_steps,
    planning.soc_steps,
    planning.lower_bound_steps,
    mrp_bench.makespan_smoothed_steps,
    mrp_bench.cost_smoothed_steps,
    planning.makespan_s,
    planning.flowtime_s,
    planning.retime_time_s,
    planning.assignment_time_s,
    mrp_bench.goals_reached,
    mrp_bench.all_goals_reached,
    service.robots_at_goal,
    mrp_bench.execution_time_s,
    mrp_bench.execution_timed_out,
    motion.driven_makespan_s,
    motion.driven_flowtime_s,
    mrp_bench.min_distance_m,
    mrp_bench.min_distance_at_start_m,
    mrp_bench.min_distance_delta_m,
    mrp_bench.time_blocked_total_s,
    mrp_bench.time_blocked_s,
    mrp_bench.run_invalid,
    service.lateness_mean_s,
    service.lateness_p95_s,
    service.lateness_max_s,
    safety.min_clearance_m,
    safety.num_overlaps,
    safety.min_wall_clearance_m,
    safety.num_wall_contacts,
    motion.sim_time_s,
    motion.wall_time_s,
    motion.cpu_time_s,
    motion.real_time_factor,
    motion.robot_seconds_per_cpu_second,
    motion.blocked_s,
    motion.execution_time_limit_s,
    tasks.throughput_per_h,
    tasks.tasks_done,
    tasks.tasks_open,
    tasks.service_time_mean_s,
    tasks.service_time_p95_s,
    tasks.warm_up_s,
)
BY_NAME = {metric.name: metric for metric in METRICS}
MACHINE_DEPENDENT = tuple(metric.name for metric in METRICS if metric.of_machine)
NUMBERS = tuple(metric.name for metric in METRICS if metric.unit != YES_NO and not metric.per_robot)
FLAGS = tuple(metric.name for metric in METRICS if metric.unit == YES_NO)
