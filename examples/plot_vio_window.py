#!/usr/bin/env python3
"""Draws what vio_window has written: the trajectory from above, and its distance from the truth over time.

    examples/plot_vio_window.py trajectory.csv [trajectory.svg]

Exit code: 0 written, 1 not a trajectory, 2 usage.
"""

import csv
import math
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "docs"))
from make_incremental_pictures import GRID, INK, OURS, STOCK, document, legend, text  # noqa: E402

COLUMNS = ["time", "x", "y", "z", "true_x", "true_y", "true_z"]


def read(path):
    """The rows of the file as tuples of numbers in the order of COLUMNS."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    if not rows or rows[0] != COLUMNS or len(rows) < 3:
        raise ValueError("not a trajectory of vio_window")
    return [tuple(float(value) for value in row) for row in rows[1:]]


def polyline(points, color, extra=""):
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="1.4" {extra}/>'


def draw_from_above(rows, x, y, side):
    places = [(row[1], row[2]) for row in rows] + [(row[4], row[5]) for row in rows]
    left, low = min(p[0] for p in places), min(p[1] for p in places)
    extent = max(max(p[0] for p in places) - left, max(p[1] for p in places) - low, 1e-9)

    def at(a, b):
        return x + side * (a - left) / extent, y + side * (1 - (b - low) / extent)

    parts = [f'<path d="M{x} {y}v{side}h{side}v{-side}z" fill="none" stroke="{GRID}"/>',
             text(x, y - 10, f"From above; the frame is {extent:.3g} m wide", 14),
             polyline([at(row[4], row[5]) for row in rows], STOCK, 'stroke-dasharray="6 3"'),
             polyline([at(row[1], row[2]) for row in rows], OURS)]
    return parts + legend(x + 10, y + side + 24, [(OURS, "estimate, not aligned"), (STOCK, "truth")])


def draw_error(rows, x, y, width, height):
    errors = [math.dist(row[1:4], row[4:7]) for row in rows]
    top, begin, end = max(max(errors), 1e-9), rows[0][0], rows[-1][0]
    points = [(x + width * (row[0] - begin) / (end - begin), y + height * (1 - error / top)) for row, error in zip(rows, errors)]
    return [text(x, y - 10, "Distance from the truth", 14),
            f'<path d="M{x} {y}v{height}h{width}" fill="none" stroke="{INK}"/>', polyline(points, OURS),
            text(x - 6, y + 4, f"{top:.3g} m", 11, "end"), text(x - 6, y + height + 4, "0", 11, "end"),
            text(x + width, y + height + 16, f"{end:.4g} s", 11, "end")]


def main():
    if len(sys.argv) not in (2, 3) or sys.argv[1].startswith("-"):
        print(__doc__.strip())
        return 0 if sys.argv[1:] == ["--help"] else 2
    source = pathlib.Path(sys.argv[1])
    try:
        rows = read(source)
    except (OSError, ValueError) as error:
        print(f"{source}: {error}", file=sys.stderr)
        return 1
    target = pathlib.Path(sys.argv[2]) if len(sys.argv) == 3 else source.with_suffix(".svg")
    parts = draw_from_above(rows, 40, 50, 420) + draw_error(rows, 560, 50, 340, 420)
    target.write_text(document(940, 540, parts), encoding="utf-8")
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
