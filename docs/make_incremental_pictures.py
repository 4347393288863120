#!/usr/bin/env python3
"""Draws the pictures of docs/incremental.md from a real replay.

    docs/make_incremental_pictures.py [--build build] [--problem path:300] [--structure_step 250] [--out docs]
    docs/make_incremental_pictures.py --report report.json [--out docs]      # a report that replay wrote before

Needs bin/replay in the build directory and nothing else: the default problem is generated. The report must be one of
`replay --mode incremental --json`, with stock and with --structure_step. Counts of work are the same on every machine, latencies are
not: leave the machine alone meanwhile. Exit code: 0 written, 2 usage or a replay that failed.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
from xml.sax.saxutils import escape

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "benchmarks"))
from stock_environment import stock_environment  # noqa: E402

INK, FAINT, GRID, PAPER = "#222222", "#b9c0c7", "#e6e9ec", "#ffffff"
OURS, STOCK, CHANGED = "#1f6fb4", "#c7522a", "#e08214"
FONT = 'font-family="Helvetica,Arial,sans-serif"'


def text(x, y, words, size=12, anchor="start", color=INK, extra=""):
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" text-anchor="{anchor}" fill="{color}" {extra}>{escape(words)}</text>'


def document(width, height, parts):
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" {FONT}>'
    return "\n".join([head, f'<rect width="{width}" height="{height}" fill="{PAPER}"/>', *parts, "</svg>", ""])


def legend(x, y, entries):
    """Entries (color, words) below each other."""
    parts = []
    for i, (color, words) in enumerate(entries):
        parts.append(f'<rect x="{x:g}" y="{y + 17 * i - 9:g}" width="11" height="11" fill="{color}"/>')
        parts.append(text(x + 17, y + 17 * i + 1, words))
    return parts


# --- the reduced system -----------------------------------------------------------------------------------------------------------


def runs(columns):
    """Stretches (first, length) of consecutive columns, which are sorted."""
    stretches = []
    for column in columns:
        if stretches and sum(stretches[-1]) == column:
            stretches[-1][1] += 1
        else:
            stretches.append([column, 1])
    return stretches


def block_paths(blocks, changed, first, scale, x, y):
    """One path for the blocks that stayed and one for those that may have changed, both rows of them having done so."""
    rows = {False: {}, True: {}}
    for row, column in blocks:
        if column >= first:
            rows[row in changed and column in changed].setdefault(row, []).append(column)
    parts = []
    for is_changed, color in ((False, FAINT), (True, CHANGED)):
        path = "".join(f"M{x + scale * (begin - first):g} {y + scale * (row - first):g}h{scale * length:g}v{scale:g}h-{scale * length:g}z"
                       for row, columns in sorted(rows[is_changed].items()) for begin, length in runs(sorted(columns)))
        parts.append(f'<path d="{path}" fill="{color}"/>' if path else "")
    return parts


def draw_structure(report):
    structure = report["structure"]
    size = len(structure["frames"])
    changed = set(structure["changed_rows"])
    blocks = structure["blocks"] + [[row, row] for row, frame in enumerate(structure["frames"]) if frame >= 0]
    hit = sum(row in changed and column in changed for row, column in blocks)
    side, x, y = 620, 30, 84
    scale = side / size
    parts = [text(x, 26, f"The reduced system S after step {structure['step']} of {report['problem']}", 16),
             text(x, 46, f"{size} frames, {len(blocks)} blocks in the lower triangle."),
             text(x, 63, f"Changed in this step: {len(changed)} block rows, at most {hit} blocks ({100 * hit / len(blocks):.0f} %)."),
             f'<path d="M{x} {y}v{side}h{side}z" fill="none" stroke="{GRID}"/>']
    parts += block_paths(blocks, changed, 0, scale, x, y)
    # The end of S again, larger, in the corner that the lower triangle leaves free.
    zoomed = min(size, 64)
    large, left, top = 290, x + side - 290, y + 6
    parts += [f'<rect x="{left}" y="{top}" width="{large}" height="{large}" fill="{PAPER}" stroke="{FAINT}"/>']
    parts += block_paths(blocks, changed, size - zoomed, large / zoomed, left, top)
    parts += [text(left + large - 6, top + 16, f"the last {zoomed} rows", 12, "end")]
    edge = x + scale * (size - zoomed)
    low = y + scale * (size - zoomed)
    parts += [f'<rect x="{edge:g}" y="{low:g}" width="{scale * zoomed:g}" height="{scale * zoomed:g}" fill="none" stroke="{INK}" '
              'stroke-dasharray="3 3"/>']
    parts += legend(x + 14, y + side - 34, [(CHANGED, "between two frames that the step changed"), (FAINT, "as it was")])
    return document(side + 2 * x, y + side + 24, parts)


# --- curves over the steps --------------------------------------------------------------------------------------------------------


def draw_panel(x, y, width, height, title, unit, steps, curves):
    """A panel with a logarithmic scale; curves are (color, name, values)."""
    smallest = min(value for _, _, values in curves for value in values if value > 0)
    largest = max(value for _, _, values in curves for value in values)
    low, high = math.floor(math.log10(smallest)), math.ceil(math.log10(largest))
    high = max(high, low + 1)

    def across(step):
        return x + width * (step - steps[0]) / max(1, steps[-1] - steps[0])

    def up(value):
        return y + height * (high - math.log10(max(value, 10.0**low))) / (high - low)

    parts = [text(x, y - 14, title, 14)]
    for exponent in range(low, high + 1):
        level = up(10.0**exponent)
        parts.append(f'<path d="M{x:g} {level:g}h{width:g}" stroke="{GRID}"/>')
        parts.append(text(x - 7, level + 4, f"{10.0 ** exponent:,.10g}", 11, "end"))
    parts.append(text(x - 7, y - 14, unit, 11, "end"))
    ticks = 50 * max(1, round((steps[-1] - steps[0]) / 300)) if steps[-1] > 60 else 10
    for step in range(ticks * math.ceil(steps[0] / ticks), steps[-1] + 1, ticks):
        parts.append(text(across(step), y + height + 16, str(step), 11, "middle"))
    parts.append(text(x + width / 2, y + height + 33, "step", 11, "middle"))
    for color, _, values in curves:
        points = " ".join(f"{across(step):.1f},{up(value):.1f}" for step, value in zip(steps, values))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.3"/>')
    return parts + legend(x + 10, y + height + 58, [(color, name) for color, name, _ in curves])


def draw_work(report):
    rows = report["rows"]
    steps = [row["step"] for row in rows]
    iterations = [row["ours"]["iterations"] for row in rows]

    def work(name):
        return [row["ours"]["work"][name] for row in rows]

    def every(name):
        return [row[name] * count for row, count in zip(rows, iterations)]

    parts = [text(30, 28, f"Work a step, {report['problem']}", 16)]
    parts += draw_panel(80, 78, 330, 280, "Landmarks: the leaves", "", steps,
                        [(FAINT, "all of them in as many iterations: a batch solver", every("landmarks")),
                         (OURS, "visited: back-substituted", work("visited_landmarks")),
                         (CHANGED, "eliminated anew", work("eliminated_landmarks"))])
    parts += draw_panel(500, 78, 330, 280, "Factors", "", steps,
                        [(FAINT, "all of them in as many iterations: a batch solver", every("factors")),
                         (OURS, "evaluated, residual only", work("evaluated_factors")),
                         (CHANGED, "relinearized", work("relinearised_factors"))])
    return document(860, 480, parts)


def draw_latency(report):
    rows = report["rows"]
    parts = [text(30, 28, f"Latency a step, {report['problem']}, {report['threads']} thread{'s' if report['threads'] > 1 else ''}", 16)]
    parts += draw_panel(80, 78, 750, 300, "Solve call of each step", "ms", [row["step"] for row in rows],
                        [(STOCK, f"{report['stock']}: median {report['stock_ms']['median']:.3g} ms", [row["stock"]["ms"] for row in rows]),
                         (OURS, f"{report['ours']}: median {report['ours_ms']['median']:.3g} ms", [row["ours"]["ms"] for row in rows])])
    return document(860, 480, parts)


# ----------------------------------------------------------------------------------------------------------------------------------


def play(options):
    """The report of a replay played now; None if it failed, which it has said itself."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "report.json"
        command = [options.build / "bin" / "replay", "--problem", options.problem, "--mode", "incremental", "--nooptimum",
                   "--stock_linear_solver", "sparse_schur", "--structure_step", str(options.structure_step), "--json", path]
        try:
            code = subprocess.run(command, env=stock_environment(), stdout=subprocess.DEVNULL, check=False).returncode
        except OSError as error:
            print(f"{error.filename}: {error.strerror}", file=sys.stderr)
            return None
        return json.loads(path.read_text(encoding="utf-8")) if code == 0 else None


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--build", type=pathlib.Path, default=root / "build", help="build directory with bin/replay")
    parser.add_argument("--problem", default="path:300", help="as replay takes it")
    parser.add_argument("--structure_step", type=int, default=250, help="the step whose S is drawn")
    parser.add_argument("--report", type=pathlib.Path, help="draw this report instead of playing")
    parser.add_argument("--out", type=pathlib.Path, default=root / "docs", help="folder for the pictures")
    options = parser.parse_args()
    report = json.loads(options.report.read_text(encoding="utf-8")) if options.report else play(options)
    if report is None:
        return 2
    if report.get("stock_ms") is None or "structure" not in report:
        print("the report needs stock and --structure_step", file=sys.stderr)
        return 2
    for name, draw in (("structure", draw_structure), ("work", draw_work), ("latency", draw_latency)):
        path = options.out / f"incremental_{name}.svg"
        path.write_text(draw(report), encoding="utf-8")
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
