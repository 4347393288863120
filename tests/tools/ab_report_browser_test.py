#!/usr/bin/env python3
"""The page of tools/ab_report in headless Chromium: it renders, says nothing on the console, nothing sticks out, and the figures a
reader sees are the log's. Argument: the script. Exit code 77, which CTest reports as skipped, if there is no Chromium."""

import html
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from ab_log_maker import line, window_run, write  # noqa: E402

SCRIPT = sys.argv[1]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

# Runs in the page, in a frame as wide as a phone or a laptop, and leaves what it measured as the outer page's text.
PROBE = """
const frame = document.querySelector('iframe');
frame.onload = () => {
  const page = frame.contentDocument, seen = [...page.querySelectorAll('svg')].filter(svg => svg.getBoundingClientRect().width > 0);
  const outside = [], tiny = [], lost = [];
  for (const svg of seen) {
    const box = svg.viewBox.baseVal, scale = svg.getBoundingClientRect().width / box.width;
    for (const text of svg.querySelectorAll('text')) {
      const b = text.getBBox();
      if (b.x < -1 || b.y < -1 || b.x + b.width > box.width + 1 || b.y + b.height > box.height + 1) outside.push(text.textContent);
      if (parseFloat(frame.contentWindow.getComputedStyle(text).fontSize) * scale < 9.5) tiny.push(text.textContent);
    }
    for (const mark of svg.querySelectorAll('circle, rect, polyline')) {
      const b = mark.getBBox();
      if (!(b.x >= -8 && b.y >= -8 && b.x + b.width <= box.width + 8 && b.y + b.height <= box.height + 8)) lost.push(mark.outerHTML);
    }
  }
  const figures = {};
  for (const figure of page.querySelectorAll('[data-value]')) {
    if (figure.getBoundingClientRect().height > 0) figures[figure.id] = figure.innerText;
  }
  const root = page.documentElement;
  const dark = frame.contentWindow.getComputedStyle(page.body).backgroundColor;
  document.querySelector('pre').textContent = JSON.stringify({figures, pictures: seen.length, points: page.querySelectorAll('circle.point').length,
    overflow: root.scrollWidth - root.clientWidth, outside, tiny, lost, background: dark, text: page.body.innerText});
};
frame.srcdoc = PAGE;
"""


def in_words(seconds):
    """As the page words a time, written down independently."""
    for factor, unit in ((1e6, "µs"), (1e3, "ms"), (1.0, "s")):
        number = seconds * factor
        if number < 999.5 or unit == "s":
            return f"{number:.{0 if number >= 99.95 else 1 if number >= 9.995 else 2}f} {unit}"
    return ""


class BrowserTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def page(self, lines):
        write(self.folder / "run.jsonl", lines)
        subprocess.run([sys.executable, SCRIPT, self.folder / "run.jsonl"], check=True, timeout=120, capture_output=True)
        return self.folder / "run.html"

    def chromium(self, path, *flags):
        command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run", "--enable-logging=stderr",
                   f"--user-data-dir={self.folder / 'profile'}", *flags, path.as_uri()]
        result = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True, env={**os.environ, "HOME": str(self.folder)})
        self.assertNotIn("CONSOLE", result.stderr)
        return result.stdout

    def measure(self, page, width, *flags):
        text = page.read_text(encoding="utf-8")
        script = PROBE.replace("PAGE", json.dumps(text).replace("</", "<\\/"))
        probe = self.folder / "probe.html"
        probe.write_text(f'<!DOCTYPE html><meta charset="utf-8"><iframe width="{width}" height="900"></iframe><pre></pre><script>{script}</script>',
                         encoding="utf-8")
        dom = self.chromium(probe, "--dump-dom", "--virtual-time-budget=20000", *flags)
        found = re.search(r"<pre>(\{.*?\})</pre>", dom, re.DOTALL)
        self.assertIsNotNone(found, "the page did not load in its frame")
        seen = json.loads(html.unescape(found.group(1)))
        for defect in ("outside", "tiny", "lost"):
            self.assertEqual(seen[defect], [], f"{defect} at {width} pixels")
        self.assertEqual(seen["overflow"], 0, f"at {width} pixels")
        self.assertNotRegex(seen["text"], r"\b(NaN|None|undefined)\b")
        return seen

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
        page = self.page(window_run(30))
        light = self.measure(page, 1366, "--blink-settings=preferredColorScheme=1")["background"]
        dark = self.measure(page, 1366, "--blink-settings=preferredColorScheme=0")["background"]
        brightness = [sum(map(int, re.findall(r"\d+", color)[:3])) for color in (light, dark)]
        self.assertGreater(brightness[0], 600)
        self.assertLess(brightness[1], 150)

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
        print("SKIPPED: no chromium, chromium-browser or google-chrome on the PATH (tools/install_packages.sh --browser)")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
