"""Reads an A/B log: one JSON object a line, written by inceres for each solve (docs/compare.md lists the fields)."""

import dataclasses
import json
import math
import re


@dataclasses.dataclass
class Solve:
    """One line that could be read. Seconds and costs are those of the log; None where a solver did not run."""

    line: int
    record: dict

    def _get(self, who, name):
        part = self.record.get(who)
        value = part.get(name) if isinstance(part, dict) else None
        return value if isinstance(value, (int, float)) and not isinstance(value, bool) else None

    def seconds(self, who):
        return self._get(who, "seconds")

    def number(self, part, name):
        return self._get(part, name)

    def text(self, name, part=None):
        holder = self.record if part is None else self.record.get(part)
        value = holder.get(name) if isinstance(holder, dict) else None
        return value if isinstance(value, str) else ""

    @property
    def compared(self):
        return isinstance(self.record.get("difference"), dict) and bool(self.seconds("ours")) and bool(self.seconds("stock"))

    @property
    def ratio(self):
        return self.seconds("ours") / self.seconds("stock")

    @property
    def cost_difference(self):
        """(ours - stock) / cost; infinite where the log could not write it."""
        value = self._get("difference", "cost")
        return math.inf if value is None else value

    @property
    def parameter_difference(self):
        value = self._get("difference", "parameter")
        return math.inf if value is None else value

    def _list(self, name):
        found = self.record["difference"].get(name, []) if self.compared else []
        return [str(entry) for entry in found] if isinstance(found, list) else []

    @property
    def violations(self):
        return self._list("violations")

    @property
    def excused(self):
        """What differs beyond tolerance, but no more than stock's own solvers do."""
        return self._list("within_spread")

    @property
    def why_alone(self):
        """The reason why only one solver ran, without what differs from solve to solve: addresses and numbers."""
        reason = self.text("fallback_reason") or self.text("not_compared") or "only one of the two solved it"
        return re.sub(r"\b\d+\b", "N", re.sub(r"0x[0-9a-fA-F]+", "0x…", reason))


def defect(record):
    """What keeps a parsed line from being a solve, or None."""
    if not isinstance(record, dict):
        return "not a JSON object"
    for who in ("ours", "stock"):
        if who not in record:
            return f'no "{who}"'
        part = record[who]
        if part is None:
            continue
        seconds = part.get("seconds") if isinstance(part, dict) else None
        if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not 0 <= seconds < math.inf:
            return f'"{who}" has no seconds'
    if record["ours"] is None and record["stock"] is None and not record.get("fallback_reason"):
        return "neither solver ran"
    return None


def read(path, progress=lambda make_text: None):
    """(solves, broken): the lines of the file in order; broken ones as (line number, reason). Empty lines are skipped. `progress` is
    called line by line with what makes a text of how far reading is."""
    solves, broken = [], []
    with open(path, encoding="utf-8", errors="replace", newline="\n") as file:
        for number, line in enumerate(file, 1):
            progress(lambda number=number: f"reading {path}: line {number:,}")
            if not line.strip():
                continue
            try:
                record = json.loads(line)
            except (ValueError, RecursionError) as error:
                broken.append((number, f"not JSON: {error}"))
                continue
            reason = defect(record)
            if reason:
                broken.append((number, reason))
            else:
                solves.append(Solve(number, record))
    return solves, broken
