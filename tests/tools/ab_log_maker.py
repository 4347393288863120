"""Writes A/B logs as inceres does, for the tests of the report and for looking at its page."""

import json
import math
import random
import sys

STAGES = {"setup": 0.06, "residuals": 0.08, "jacobians": 0.42, "hessian": 0.12, "elimination": 0.14, "factorization": 0.06,
          "back_substitution": 0.03, "model_cost": 0.04}


def outcome(seconds, cost, iterations, ours):
    part = {"seconds": seconds, "initial_cost": 40 * cost, "final_cost": cost, "iterations": iterations, "termination": "CONVERGENCE",
            "message": "Function tolerance reached. |cost_change|/cost: 3.2e-07 <= 1.0e-06"}
    if ours:
        part.update({"kernels": "avx512", "stages": {**{name: share * seconds for name, share in STAGES.items()}, "total": 0.95 * seconds},
                     "work": {"reduced_size": 150}})
    return part


def line(k, ours=0.003, stock=0.008, cost=1234.5, cost_difference=1e-13, fallback="", violations=(), excused=()):
    """One line; ours None: stock alone."""
    difference = None if ours is None else {
        "cost": cost_difference, "parameter": 1e3 * abs(cost_difference), "parameter_block": 7, "parameter_block_size": 7, "component": 2,
        "iterations": 0, "first_iteration": 3 if violations else -1, "violations": list(violations), "within_spread": list(excused), "spread": None, "note": "",
        "tolerances": {"cost": 1e-9, "parameters": 1e-6, "iterations": 1.0, "radius": 1e-6}}
    return {"time": f"2026-05-04T10:{k // 600 % 60:02d}:{k // 10 % 60:02d}.{100 * (k % 10):03d}Z", "process": 4711, "solve": k, "mode": "exact",
            "function_tolerance": 1e-6,
            "sizes": {"parameter_blocks": 172, "parameters": 350 + k % 7, "effective_parameters": 321 + k % 7, "residual_blocks": 615 + k % 31,
                      "residuals": 1230 + 2 * (k % 31), "constant_parameter_blocks": 1},
            "structure": {"linear_solver_given": "DENSE_SCHUR", "linear_solver_used": "DENSE_SCHUR", "schur_structure": "2,d,d", "strategy": "DOGLEG",
                          "threads": 1, "landmarks": 150, "frames": 22, "reduced_solver": "dense_cholesky"},
            "ours": None if ours is None else outcome(ours, cost * (1 + cost_difference), 7, True), "stock": outcome(stock, cost, 7, False),
            "difference": difference, "first": "stock" if k % 2 or ours is None else "ours", "kept": "ours", "fallback_reason": fallback,
            "not_compared": "" if difference else fallback,
            "machine": {"cpu": "Example CPU @ 3.00 GHz", "hardware_threads": 8, "inceres": "0.1.0", "ceres": "2.1.0-eigen-(3.4.0)"}}


def window_run(count, seed=1):
    """A run as a sliding window gives it: latencies that wander, a few slow solves, three reasons for fallbacks, one violation, two
    differences that stock's own solvers show too."""
    rng = random.Random(seed)
    lines, level = [], 0.0
    for k in range(count):
        level = 0.97 * level + rng.gauss(0, 0.05)
        work = math.exp(level) * (1.0 + 0.25 * math.sin(k / 25))
        stock = 0.0082 * work * math.exp(abs(rng.gauss(0, 0.09))) * (3.0 if rng.random() < 0.01 else 1.0)
        ours = 0.0031 * work * math.exp(abs(rng.gauss(0, 0.10))) * (2.5 if rng.random() < 0.008 else 1.0)
        size = 0.0 if rng.random() < 0.08 else rng.choice((-1, 1)) * 10 ** rng.uniform(-15.5, -11)
        if k % 83 == 40:
            lines.append(line(k, None, stock, fallback=f"bounds: parameter block 0x55{k:08x} of size 1 has some" if k % 2 else "minimizer_type LINE_SEARCH"))
        elif k == count // 2:
            lines.append(line(k, ours, stock, 1234.5, 3e-8, violations=["cost of iteration 3: ours 1234.5, stock 1234.49 (difference 3e-08, tolerance 1e-09)"]))
        else:
            excused = ["cost of iteration 0: ours 1234.5, stock 1234.49"] if k in (count // 3, count // 3 + 1) else ()
            lines.append(line(k, ours, stock, 1000 * work, size, excused=excused))
    return lines


def write(path, lines):
    """Lines may be records or text to be written as it stands."""
    with open(path, "w", encoding="utf-8") as file:
        for record in lines:
            file.write((record if isinstance(record, str) else json.dumps(record)) + "\n")


if __name__ == "__main__":
    write(sys.argv[2], window_run(int(sys.argv[1])))
