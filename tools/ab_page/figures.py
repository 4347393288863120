"""The figures of the page: plain numbers from the solves of a log, no drawing."""

import collections
import math
import statistics


def percentile(values, fraction):
    """The smallest value that the given fraction of them does not exceed (nearest rank), as in the tools' other reports."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(fraction * len(ordered) - 1e-9) - 1)]


def spread(values):
    return {"median": statistics.median(values), "p95": percentile(values, 0.95), "max": max(values), "total": sum(values)}


def headline(solves):
    """The page's first figures; None if no solve was done by both."""
    compared = [solve for solve in solves if solve.compared]
    if not compared:
        return None
    ours = spread([solve.seconds("ours") for solve in compared])
    stock = spread([solve.seconds("stock") for solve in compared])
    ratios = [solve.ratio for solve in compared]
    by_first = {who: [solve.ratio for solve in compared if solve.text("first") == who] for who in ("ours", "stock")}
    return {
        "num_compared": len(compared),
        "ratio": statistics.median(ratios),
        "ratio_p95": percentile(ratios, 0.95),
        "ratio_total": ours["total"] / stock["total"],
        "ratio_by_first": {who: statistics.median(values) for who, values in by_first.items() if values},
        "num_faster": sum(ratio < 1 for ratio in ratios),
        "ours": ours,
        "stock": stock,
        "num_disagreeing": sum(bool(solve.violations) for solve in compared),
        "num_excused": sum(bool(solve.excused) for solve in compared),
        "largest_cost_difference": max((abs(solve.cost_difference) for solve in compared)),
        "largest_parameter_difference": max(solve.parameter_difference for solve in compared),
    }


def alone(solves):
    """[(reason, number of solves, their seconds, first line)] of what only one solver solved, the most frequent first."""
    groups = collections.defaultdict(list)
    for solve in solves:
        if not solve.compared:
            groups[solve.why_alone].append(solve)
    rows = [(reason, len(group), sum(solve.seconds("stock") or solve.seconds("ours") or 0.0 for solve in group), group[0].line)
            for reason, group in groups.items()]
    return sorted(rows, key=lambda row: (-row[1], row[0]))


# The log's names of stages in the order of the work, in words.
STAGES = (("setup", "set-up"), ("residuals", "residuals"), ("jacobians", "Jacobians"), ("hessian", "Hessian"),
          ("elimination", "elimination"), ("factorization", "factorization"), ("back_substitution", "back-substitution"),
          ("model_cost", "model cost"))


def stages(solves):
    """[(words, seconds)] of our exact solves, summed; the rest of the call is the last one. Empty without such solves."""
    totals = dict.fromkeys((name for name, _ in STAGES), 0.0)
    whole = 0.0
    for solve in solves:
        parts = (solve.record.get("ours") or {}).get("stages")
        if isinstance(parts, dict):
            whole += solve.seconds("ours")
            for name in totals:
                value = parts.get(name)
                totals[name] += value if isinstance(value, (int, float)) else 0.0
    if whole <= 0.0:
        return []
    rest = max(0.0, whole - sum(totals.values()))
    return [(words, totals[name]) for name, words in STAGES if totals[name] > 0] + [("around the solver", rest)]


def counted(values):
    """[(value, count)], the most frequent first."""
    return collections.Counter(str(value) for value in values if value not in (None, "")).most_common()


def environment(solves):
    """[(name, [(value, count)])] of what the figures depend on."""
    sizes = [(name, [solve.number("sizes", key) for solve in solves]) for name, key in
             (("Residuals", "residuals"), ("Variables (tangent)", "effective_parameters"))]
    rows = [("Processor", counted(solve.text("cpu", "machine") for solve in solves)),
            ("Hardware threads", counted(solve.number("machine", "hardware_threads") for solve in solves)),
            ("Threads used", counted(solve.number("structure", "threads") for solve in solves)),
            ("Instruction set", counted(solve.text("kernels", "ours") for solve in solves)),
            ("inceres", counted(solve.text("inceres", "machine") for solve in solves)),
            ("Ceres", counted(solve.text("ceres", "machine") for solve in solves)),
            ("Mode", counted(solve.text("mode") for solve in solves)),
            ("Linear solver", counted(solve.text("linear_solver_given", "structure") for solve in solves)),
            ("Strategy", counted(solve.text("strategy", "structure") for solve in solves)),
            ("Our reduced solver", counted(solve.text("reduced_solver", "structure") for solve in solves)),
            ("Function tolerance", counted(solve.record.get("function_tolerance") for solve in solves)),
            ("Processes", counted(solve.record.get("process") for solve in solves))]
    for name, values in sizes:
        known = [value for value in values if value is not None and value >= 0]
        if known:
            rows.append((name, [(f"{min(known):,} to {max(known):,}, median {statistics.median(known):,.0f}", len(known))]))
    return [(name, values) for name, values in rows if values]
