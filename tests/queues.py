"""Systems whose truth is known: queues with Poisson arrivals and c servers, simulated many at a time."""

import math

import numpy as np


def mean_wait_s(arrivals_per_s, service_s, servers):
    """Mean time in the queue of M/M/c in the steady state (Erlang's C formula)."""
    load = arrivals_per_s * service_s
    share = load / servers
    full = load**servers / math.factorial(servers) / (1 - share)
    waits = full / (sum(load**k / math.factorial(k) for k in range(servers)) + full)
    return waits * service_s / (servers - load)


def waits_s(rng, num_runs, num_customers, arrivals_per_s, service_s, servers):
    """[num_runs, num_customers] times in the queue, each run from an empty system (Kiefer and Wolfowitz's recursion)."""
    between = rng.exponential(1 / arrivals_per_s, (num_customers, num_runs))
    service = rng.exponential(service_s, (num_customers, num_runs))
    left = np.zeros((num_runs, servers))  # work of each server, ascending
    result = np.empty((num_runs, num_customers))
    for k in range(num_customers):
        result[:, k] = left[:, 0]
        left[:, 0] += service[k]
        left = np.sort(np.maximum(left - between[k][:, None], 0.0), axis=1)
    return result


def coverage(seed, num_studies, replications, num_customers, servers=2, share=0.7):
    """Share of studies whose 95 % limits of the mean wait hold the truth; the warm-up is left out by MSER-5 on the study's mean series."""
    from mrp_sumo.experiments.statistics import t_mean
    from mrp_sumo.metrics.warm_up import warm_up_length

    truth, rng, hits = mean_wait_s(servers * share, 1.0, servers), np.random.default_rng(seed), 0
    together = max(1, 10_000_000 // (replications * num_customers))  # studies in memory at a time
    for first in range(0, num_studies, together):
        count = min(together, num_studies - first)
        for runs in waits_s(rng, count * replications, num_customers, servers * share, 1.0, servers).reshape(count, replications, -1):
            cut = warm_up_length(runs.mean(0)[: num_customers // 60 * 60].reshape(60, -1).mean(1)) or 0
            limits = t_mean(runs[:, cut * (num_customers // 60) :].mean(1))
            hits += limits.low <= truth <= limits.high
    return hits / num_studies
