"""Looks at a page in headless Chromium: it renders, says nothing on the console, and nothing sticks
out."""

import html
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
                None)
SKIPPED = ("SKIPPED: no chromium, chromium-browser or google-chrome on the PATH "
           "(tools/install_packages.sh --browser)")

# Runs in the page, in a frame as wide as a phone or a laptop, and leaves what it measured as the
# outer page's text.
PROBE = """
const frame = document.querySelector('iframe');
frame.onload = () => {
  const page = frame.contentDocument, seen = [...page.querySelectorAll('svg')].filter(svg =>
    svg.getBoundingClientRect().width > 0);
  const outside = [], tiny = [], lost = [];
  for (const svg of seen) {
    const box = svg.viewBox.baseVal, scale = svg.getBoundingClientRect().width / box.width;
    const right = box.x + box.width, bottom = box.y + box.height;
    for (const text of svg.querySelectorAll('text')) {
      const b = text.getBBox();
      if (b.x < box.x - 1 || b.y < box.y - 1 || b.x + b.width > right + 1 || b.y + b.height >
        bottom + 1) outside.push(text.textContent);
      if (parseFloat(frame.contentWindow.getComputedStyle(text).fontSize) * scale < 9.5)
        tiny.push(text.textContent);
    }
    for (const mark of svg.querySelectorAll('circle, rect, polyline')) {
      const b = mark.getBBox();
      if (!(b.x >= box.x - 8 && b.y >= box.y - 8 && b.x + b.width <= right + 8 && b.y + b.height
        <= bottom + 8)) lost.push(mark.outerHTML);
    }
  }
  const figures = {};
  for (const figure of page.querySelectorAll('[data-value]')) {
    if (figure.getBoundingClientRect().height > 0) figures[figure.id] = figure.innerText;
  }
  const root = page.documentElement;
  const dark = frame.contentWindow.getComputedStyle(page.body).backgroundColor;
  document.querySelector('pre').textContent = JSON.stringify({figures, pictures: seen.length,
    points: page.querySelectorAll('circle.point').length,
    overflow: root.scrollWidth - root.clientWidth, outside, tiny, lost, background: dark, text:
      page.body.innerText});
};
frame.srcdoc = PAGE;
"""


class PageTestCase(unittest.TestCase):
    """A test of pages, with a folder of its own for them."""

    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def chromium(self, path, *flags):
        command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu",
                   "--disable-dev-shm-usage", "--no-first-run", "--enable-logging=stderr",
                   f"--user-data-dir={self.folder / 'profile'}", *flags, path.as_uri()]
        result = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True,
                                env={**os.environ, "HOME": str(self.folder)})
        self.assertNotIn("CONSOLE", result.stderr)
        return result.stdout

    def measure(self, page, width, *flags):
        """What there is to see in a window of this width; checks what holds for every page."""
        text = page.read_text(encoding="utf-8")
        script = PROBE.replace("PAGE", json.dumps(text).replace("</", "<\\/"))
        probe = self.folder / "probe.html"
        probe.write_text(f'<!DOCTYPE html><meta charset="utf-8"><iframe width="{width}" '
                         f'height="900"></iframe><pre></pre><script>{script}</script>',
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

    def check_light_and_dark(self, page):
        light = self.measure(page, 1366, "--blink-settings=preferredColorScheme=1")["background"]
        dark = self.measure(page, 1366, "--blink-settings=preferredColorScheme=0")["background"]
        brightness = [sum(map(int, re.findall(r"\d+", color)[:3])) for color in (light, dark)]
        self.assertGreater(brightness[0], 600)
        self.assertLess(brightness[1], 150)
