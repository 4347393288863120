#!/usr/bin/env python3
"""The page of tools/ab_report in headless Chromium: it renders, says nothing on the console, nothing sticks out, and the figures a
reader sees are the log's. Argument: the script. Exit code 77, which CTest reports as skipped, if there is no Chromium."""

import statistics
import subprocess
import sys
import unittest

sys.dont_write_bytecode = True
from ab_log_maker import line, window_run, write  # noqa: E402
from browser_page import CHROMIUM, SKIPPED, PageTestCase  # noqa: E402

SCRIPT = sys.argv[1]


def in_words(seconds):
    """As the page words a time, written down independently."""
    for factor, unit in ((1e6, "µs"), (1e3, "ms"), (1.0, "s")):
        number = seconds * factor
        if number < 999.5 or unit == "s":
            return f"{number:.{0 if number >= 99.95 else 1 if number >= 9.995 else 2}f} {unit}"
    return ""


class BrowserTest(PageTestCase):
    def page(self, lines):
        write(self.folder / "run.jsonl", lines)
        subprocess.run([sys.executable, SCRIPT, self.folder / "run.jsonl"], check=True, timeout=120, capture_output=True)
        return self.folder / "run.html"

    def test_a_run_on_a_laptop_and_a_phone(self):
        records = window_run(300)
        page = self.page(records)
        both = [r for r in records if r["ours"]]
        expected = {"ratio": f'{statistics.median(r["ours"]["seconds"] / r["stock"]["seconds"] for r in both):.3f}',
                    "ratio_total": f'{sum(r["ours"]["seconds"] for r in both) / sum(r["stock"]["seconds"] for r in both):.3f}',
                    "median_ours": in_words(statistics.median(r["ours"]["seconds"] for r in both)),
                    "median_stock": in_words(statistics.median(r["stock"]["seconds"] for r in both)),
                    "total_ours": in_words(sum(r["ours"]["seconds"] for r in both)),
                    "total_stock": in_words(sum(r["stock"]["seconds"] for r in both)),
                    "max_ours": in_words(max(r["ours"]["seconds"] for r in both)),
                    "max_stock": in_words(max(r["stock"]["seconds"] for r in both)),
                    "num_disagreeing": "1", "num_alone": str(len(records) - len(both)), "num_solves": "300 solves"}
        for width in (1366, 360):
            seen = self.measure(page, width)
            self.assertEqual({name: seen["figures"].get(name) for name in expected}, expected)
            self.assertEqual(seen["pictures"], 4)
            self.assertEqual(seen["points"], 4 * len(both))

    def test_light_and_dark(self):
        self.check_light_and_dark(self.page(window_run(30)))

    def test_odd_logs(self):
        extremes = [line(0, 1e-6, 1e3), line(1, 1e3, 1e-6, cost_difference=0.5), line(2, cost_difference=0.0), line(3)]
        extremes[1]["difference"]["cost"] = None
        logs = {"empty": [], "one": [line(0)], "fallbacks": [line(k, None, fallback="bounds") for k in range(3)], "broken": ["{"], "extremes": extremes,
                "equal": [line(k, 0.002, 0.002, cost_difference=0.0) for k in range(3)], "long": window_run(5000)}
        for name, lines in logs.items():
            for width in (1366, 360):
                with self.subTest(log=name, width=width):
                    seen = self.measure(self.page(lines), width)
                    self.assertEqual(seen["pictures"], 0 if name in ("empty", "fallbacks", "broken") else 4)

    def test_a_screenshot_is_no_blank(self):
        picture = self.folder / "page.png"
        self.chromium(self.page(window_run(100)), f"--screenshot={picture}", "--window-size=1280,2400", "--hide-scrollbars")
        self.assertGreater(picture.stat().st_size, 60000)  # an empty one compresses to a few thousand bytes


if __name__ == "__main__":
    if CHROMIUM is None:
        print(SKIPPED)
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
