#!/usr/bin/env python3
"""Draws the picture of docs/visual_inertial.md from a Monte Carlo run of the visual-inertial window.

    docs/make_window_pictures.py [--build build] [--runs 100] [--frames 100] [--rule okvis] [--out docs]
    docs/make_window_pictures.py --report consistency.json [--out docs]     # that window_consistency wrote before

Needs bin/window_consistency in the build directory (configure with -DINCERES_BUILD_BENCHMARKS=ON). The same seeds give the same
picture. Exit code: 0 written, 2 usage or a run that failed.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from make_incremental_pictures import CHANGED, FAINT, GRID, INK, OURS, STOCK, document, legend, text

CURVES = (("with", OURS), ("without", STOCK), ("exact", FAINT))


def draw(report):
    x, y, width, height = 70, 92, 760, 300
    times, band = report["times"], report["band"]
    top = 24.0
    parts = [text(30, 28, "Are the covariances right? Normalized error squared of the newest pose", 16),
             text(30, 48, f"Mean over {report['runs']} simulated windows of {report['size']} frames, rule of {report['rule'].upper()}; 6 if they are. Dark band: where "
                          "95 % of such means lie. Cut off at the top."),
             f'<clipPath id="panel"><rect x="{x}" y="{y}" width="{width}" height="{height}"/></clipPath>']

    def up(value):
        return y + height * (1 - value / top)

    for level in range(0, int(top) + 1, 6):
        parts.append(f'<path d="M{x} {up(level):g}h{width}" stroke="{GRID}"/>')
        parts.append(text(x - 8, up(level) + 4, str(level), 11, "end"))
    parts.append(f'<rect x="{x}" y="{up(6 + band):g}" width="{width}" height="{up(6 - band) - up(6 + band):g}" fill="{CHANGED}" '
                 'opacity="0.25"/>')
    for key, color in reversed(CURVES):
        points = " ".join(f"{x + width * (time - times[0]) / (times[-1] - times[0]):.1f},{up(value):.1f}"
                          for time, value in zip(times, report[key]["nees"]))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.6" clip-path="url(#panel)"/>')
    for tick in range(int(times[0]) + 1, int(times[-1]) + 1, max(1, round(times[-1] / 12))):
        parts.append(text(x + width * (tick - times[0]) / (times[-1] - times[0]), y + height + 17, f"{tick} s", 11, "middle", INK))
    entries = []
    for key, color in CURVES:
        mean = sum(report[key]["nees"]) / len(report[key]["nees"])
        entries.append((color, f"{report[key]['name']}: mean {mean:.3g}, error {100 * report[key]['rms']:.2g} cm (RMS)"))
    parts += legend(x + 10, y + height + 42, entries)
    return document(860, 500, parts)


def play(options):
    """The report of runs played now; None if they failed. That some mean lies outside the band is no failure."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "report.json"
        command = [options.build / "bin" / "window_consistency", f"--runs={options.runs}", f"--frames={options.frames}", f"--rule={options.rule}",
                   f"--json={path}"]
        try:
            subprocess.run(command, check=False)
            return json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            print(error, file=sys.stderr)
            return None


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--build", type=pathlib.Path, default=root / "build", help="build directory with bin/window_consistency")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--rule", default="okvis", help="okvis or vins: which landmarks go with an old frame")
    parser.add_argument("--report", type=pathlib.Path, help="draw this report instead of playing")
    parser.add_argument("--out", type=pathlib.Path, default=root / "docs", help="folder for the picture")
    options = parser.parse_args()
    report = json.loads(options.report.read_text(encoding="utf-8")) if options.report else play(options)
    if report is None:
        return 2
    path = options.out / "window_consistency.svg"
    path.write_text(draw(report), encoding="utf-8")
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
