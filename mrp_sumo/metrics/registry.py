"""All bundled metrics: by table, as the documentation has them, and in the order of `result.json` and of the columns of results.

Documentation, reports, comparisons and batches read these; a metric's unit, sense and formula stand nowhere else.
Tables are wrapped by hand (`fmt: off`), or each argument of a metric would take a line.
"""

from mrp_sumo.metrics import facilities, fleet_use, motion, mrp_bench, people, planning, tasks, zones
from mrp_sumo.metrics.metric import YES_NO, Metric

TABLES = {
    "planning": planning.METRICS,
    "service": motion.SERVICE,
    "motion": motion.MOTION,
    "safety": motion.SAFETY,
    "facilities": facilities.METRICS,
    "mrp_bench": mrp_bench.METRICS,
    "tasks": tasks.METRICS,
    "fleet_use": fleet_use.METRICS,
    "people": people.METRICS,
    "zones": zones.METRICS,
}
ORDER = """
    num_robots plan_success plan_valid num_vertex_conflicts num_edge_conflicts num_following_conflicts planning_time_s planning_cpu_s
    prepare_time_s makespan_steps cost_steps soc_steps lower_bound_steps makespan_smoothed_steps cost_smoothed_steps makespan_s
    flowtime_s retime_time_s assignment_time_s goals_reached all_goals_reached robots_at_goal execution_time_s execution_timed_out
    driven_makespan_s driven_flowtime_s min_distance_m min_distance_at_start_m min_distance_delta_m time_blocked_total_s time_blocked_s
    run_invalid lateness_mean_s lateness_p95_s lateness_max_s min_clearance_m num_overlaps min_wall_clearance_m num_wall_contacts
    sim_time_s wall_time_s cpu_time_s real_time_factor robot_seconds_per_cpu_second blocked_s execution_time_limit_s throughput_per_h
    tasks_done tasks_open tasks_failed tasks_cancelled tasks_handed_over tasks_begun_anew lead_time_mean_s lead_time_p95_s
    warm_up_s lead_time_p50_s lead_time_max_s cycle_assignment_s cycle_empty_travel_s cycle_loaded_travel_s cycle_standing_s
    cycle_queue_s cycle_serving_s on_time_share station_utilisation_mean station_utilisation_max robot_busy_share planner_calls
    planner_calls_late planner_calls_failed planner_calls_stepped planner_calls_stopped waiting_time_p50_s waiting_time_p95_s
    task_time_p50_s task_time_p95_s robot_working_share robot_blocked_share robot_charging_share robot_idle_share robot_lost_share
    availability robot_stalled_share station_queue_mean station_queue_max distance_m empty_distance_m distance_per_order_m loads_mean
    bundled_saved_share energy_j battery_level_min
    robots_battery_critical robots_battery_empty lift_rides lift_wait_s lift_queue_max lift_utilisation_max door_openings num_people
    protective_stops_per_robot_h lost_to_people_s min_person_distance_m people_waiting_s num_person_contacts num_person_touches
    zone_occupancy_max zone_robots_mean_max zone_robots_max
"""
_BY_NAME = {metric.name: metric for table in TABLES.values() for metric in table}
METRICS: tuple[Metric, ...] = tuple(_BY_NAME[name] for name in ORDER.split())
BY_NAME = {metric.name: metric for metric in METRICS}
MACHINE_DEPENDENT = tuple(metric.name for metric in METRICS if metric.of_machine)
NUMBERS = tuple(metric.name for metric in METRICS if metric.unit != YES_NO and not metric.per_robot)
FLAGS = tuple(metric.name for metric in METRICS if metric.unit == YES_NO)
