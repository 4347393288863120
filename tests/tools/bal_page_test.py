#!/usr/bin/env python3
"""The page of bal_solve --picture: its parts, and the numbers of the run. Arguments: the
executable, the folder of bundled problems."""

import html.parser
import json
import os
import re
import sys
import tempfile
import unittest

from tool_test_support import bundled_problem, run, write_small_bal

TOOL, BAL_DATA = sys.argv[1:3]
PARTS = {"before", "before_top", "before_side", "after", "after_top", "after_side", "cost",
         "errors", "facts"}
VOID = {"meta", "link"}


class Page(html.parser.HTMLParser):
    """What a page has: ids, figures, references, and how many elements of a class within each
    id."""

    def __init__(self, text):
        super().__init__()
        self.figures, self.references, self.counts, self.open, self.errors = {}, [], {}, [], []
        self.feed(text)
        self.errors += [f"{tag} is not closed" for tag, _ in self.open]

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.references += [value for name, value in attributes.items()
                            if name in ("src", "href", "xlink:href")]
        if tag not in VOID:
            self.open.append((tag, attributes.get("id")))
        for identity in {identity for _, identity in self.open if identity}:
            of_class = self.counts.setdefault(identity, {})
            name = attributes.get("class", tag)
            of_class[name] = of_class.get(name, 0) + 1
        if "data-value" in attributes:
            self.figures[attributes["id"]] = float(attributes["data-value"])

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open.pop()[0] != tag:
            self.errors.append(f"</{tag}> at {self.getpos()}")


class BalPageTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = directory.name
        self.small = os.path.join(self.folder, "a<b>&c.txt")
        write_small_bal(self.small)

    def draw(self, problem, *flags):
        """(the page, its text, the JSON report)"""
        page, report = (os.path.join(self.folder, name) for name in ("page.html", "report.json"))
        run(TOOL, "--input", problem, "--picture", page, "--json", report, *flags)
        with open(page, encoding="utf-8") as file, open(report, encoding="utf-8") as json_file:
            text = file.read()
            return Page(text), text, json.load(json_file)

    def test_parts_and_numbers(self):
        for flags in ((), ("--builtin_factors",), ("--solver", "ceres"), ("--mode", "incremental"),
                      ("--robust", "huber:0.5"),
                      ("--mode", "incremental", "--builtin_factors"),
                      ("--max_num_iterations", "0")):
            page, text, report = self.draw(self.small, *flags)
            self.assertEqual(page.errors, [], flags)
            self.assertEqual(PARTS - set(page.counts), set(), flags)
            for key in ("num_cameras", "num_points", "num_observations", "initial_cost",
                        "final_cost", "initial_rms_pixels",
                        "final_rms_pixels", "iterations", "seconds"):
                self.assertEqual(page.figures[key], report[key], (key, flags))
            for view in ("before_top", "before_side", "after_top", "after_side"):
                self.assertEqual(page.counts[view]["camera"], report["num_cameras"], view)
            samples = sum(page.counts["cost"].get(kind, 0) for kind in ("accepted", "rejected"))
            self.assertEqual(samples,
                             2 * len(report["trace"]))  # drawn for a wide and a narrow screen
            self.assertIn(f"{report['termination']}: ", text)
            self.assertNotRegex(text, r"\b(nan|inf)\b")

    def test_the_histogram_counts_every_observation(self):
        _, text, report = self.draw(self.small)
        for when in ("before", "after"):
            counts = [int(count) for count in re.findall(rf"<title>{when}: (\d+) of ", text)]
            self.assertEqual(sum(counts), 2 * report["num_observations"], when)

    def test_errors_fall(self):
        page, _, report = self.draw(bundled_problem(BAL_DATA))
        for name in ("median", "p95"):
            self.assertLess(page.figures[f"{name}_error_after"],
                            page.figures[f"{name}_error_before"])
        self.assertLess(page.figures["median_error_after"], 1.5 * report["final_rms_pixels"])
        self.assertGreaterEqual(page.figures["max_error_after"], report["final_rms_pixels"])

    def test_nothing_is_fetched_and_names_are_escaped(self):
        page, text, _ = self.draw(self.small)
        self.assertEqual(page.references, ["data:,"])
        self.assertNotRegex(text, r"<script|@import|https?:|url\((?!#)")
        self.assertIn("<h1>a&lt;b&gt;&amp;c.txt</h1>", text)
        self.assertEqual(self.draw(self.small)[0].counts, page.counts)

    def test_many_points_are_thinned_out(self):
        big = os.path.join(self.folder, "big.txt")
        write_small_bal(big, num_cameras=3, num_points=20000)
        _, text, _ = self.draw(big, "--builtin_factors", "--max_num_iterations", "2")
        self.assertIn("Of the points one of 3 is drawn.", text)
        self.assertLess(len(text), 1_500_000)
        points = re.findall(r'class="points" d="([^"]*)"', text)
        self.assertEqual(len(points), 4)
        for path in points:
            self.assertLessEqual(path.count("M"), 6667)
        self.assertGreater(points[2].count("M"), 3000)

    def test_a_picture_of_another_name_is_svg(self):
        for name in ("picture.svg", "picture"):
            path = os.path.join(self.folder, name)
            run(TOOL, "--input", self.small, "--picture", path)
            with open(path, encoding="utf-8") as file:
                self.assertTrue(file.read().startswith("<?xml"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
