#!/usr/bin/env python3
"""The page of bal_solve --picture in headless Chromium, on a laptop and a phone, light and dark.
Arguments: the executable, the folder of bundled problems. Exit code 77, which CTest reports as
skipped, if there is no Chromium."""

import json
import sys
import unittest

sys.dont_write_bytecode = True
from browser_page import CHROMIUM, SKIPPED, PageTestCase  # noqa: E402
from tool_test_support import bundled_problem, run  # noqa: E402

TOOL, BAL_DATA = sys.argv[1:3]


class BalPageBrowserTest(PageTestCase):
    def draw(self, *flags):
        page, report = self.folder / "page.html", self.folder / "report.json"
        run(TOOL, "--input", bundled_problem(BAL_DATA), "--picture", page, "--json", report, *flags)
        return page, json.loads(report.read_text(encoding="utf-8"))

    def test_on_a_laptop_and_a_phone(self):
        for flags in ((), ("--mode", "incremental")):
            page, report = self.draw(*flags)
            for width in (1366, 360):
                seen = self.measure(page, width)
                self.assertEqual(seen["pictures"], 4)  # two scenes, cost curve, histogram
                figures = seen["figures"]
                self.assertEqual(figures["iterations"], str(report["iterations"]))
                self.assertEqual(figures["final_cost"], f"{report['final_cost']:.6g}")
                self.assertEqual(figures["initial_rms_pixels"],
                                 f"{report['initial_rms_pixels']:.4g}")
                self.assertIn("from the side", seen["text"])

    def test_light_and_dark(self):
        self.check_light_and_dark(self.draw()[0])

    def test_a_screenshot_is_no_blank(self):
        picture = self.folder / "page.png"
        self.chromium(self.draw()[0], f"--screenshot={picture}", "--window-size=1280,1900",
                      "--hide-scrollbars")
        self.assertGreater(picture.stat().st_size, 60000)


if __name__ == "__main__":
    if CHROMIUM is None:
        print(SKIPPED)
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
