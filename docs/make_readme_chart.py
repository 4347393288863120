#!/usr/bin/env python3
"""Draws the README's bar chart and prints its table, both from benchmarks/readme_figures.json.

    docs/make_readme_chart.py            writes docs/readme_chart.svg, prints the table
    docs/make_readme_chart.py --check    writes nothing; exits with 1 if chart or README differ, or
                                         the README is longer than 120 lines of 120 columns

The JSON has each row with its command, machine, commit and date; benchmarks/readme_table.py
--record measures those rows anew that it can.
"""

import json
import pathlib
import sys
from xml.sax.saxutils import escape

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIGURES = ROOT / "benchmarks" / "readme_figures.json"
CHART = ROOT / "docs" / "readme_chart.svg"
PAGE = 120  # lines of the README, and columns

WIDTH, LEFT, ROW, BAR, UNIT = 860, 355, 38, 13, 160  # pixels; UNIT is Ceres's time


def time_of(milliseconds):
    """As a person would write it, with two or three digits."""
    if milliseconds >= 1e4:
        return f"{milliseconds / 1e3:.0f} s"
    return f"{milliseconds:.0f} ms" if milliseconds >= 10 else f"{milliseconds:.2g} ms"


def speed_up(row):
    times = 1.0 / row["ratio"]
    return f"{times:.0f}×" if times >= 10 else f"{times:.1f}×"


def table(rows):
    lines = ["| problem | Ceres | inceres | speed-up |", "|---|---|---|---|"]
    lines += [f"| {row['problem']} | {time_of(row['ceres_ms'])} | {time_of(row['inceres_ms'])} | "
              f"**{speed_up(row)}** |" for row in rows]
    return "\n".join(lines)


def bar(x, y, width, color, label):
    return (f'<rect x="{x}" y="{y}" width="{width:.1f}" height="{BAR}" fill="{color}"/>\n'
            f'<text x="{x + width + 5:.1f}" y="{y + 11}">{escape(label)}</text>')


def chart(rows):
    height = ROW * len(rows) + 34
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
             'font-family="sans-serif" font-size="12">',
             f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
             '<title>Time of a solve: Ceres and inceres; each pair in units of Ceres</title>']
    for i, row in enumerate(rows):
        y = 10 + ROW * i
        parts += [f'<text x="{LEFT - 10}" y="{y + 17}" text-anchor="end">'
                  f'{escape(row["problem"])}</text>',
                  bar(LEFT, y, UNIT, "#b0b7bf", f"Ceres {time_of(row['ceres_ms'])}"),
                  bar(LEFT, y + BAR, UNIT * row["ratio"], "#1f77b4",
                      f"inceres {time_of(row['inceres_ms'])}: {speed_up(row)}")]
    parts += [f'<text x="{LEFT}" y="{height - 8}" fill="#666">each pair in units of Ceres\'s time; '
              'one thread; shorter is better</text>', "</svg>"]
    return "\n".join(parts) + "\n"


def main(arguments):
    if arguments not in ([], ["--check"]):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    rows = json.loads(FIGURES.read_text(encoding="utf-8"))["rows"]
    if not arguments:
        CHART.write_text(chart(rows), encoding="utf-8")
        print(table(rows))
        return 0
    problems = []
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    if len(readme.splitlines()) > PAGE or max(map(len, readme.splitlines())) > PAGE:
        problems.append(f"README.md is longer than {PAGE} lines, or a line than {PAGE} columns")
    if not CHART.is_file() or CHART.read_text(encoding="utf-8") != chart(rows):
        problems.append(f"{CHART} is not the chart of {FIGURES}: run docs/make_readme_chart.py")
    if table(rows) not in readme:
        problems.append(f"README.md does not have the table of {FIGURES}:\n{table(rows)}")
    print("\n".join(problems) or f"the README's chart and table are those of {FIGURES.name}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
