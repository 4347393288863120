#!/usr/bin/env python3
"""tools/ab_report: its page says what the log says, whatever the log is. Arguments: the script, adapter_cross_check_test."""

import html.parser
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from ab_log_maker import line, window_run, write  # noqa: E402

SCRIPT, WRITER = sys.argv[1:3]


class Page(html.parser.HTMLParser):
    """Figures (id -> number), ids with their attributes and text, and all tags in order."""

    def __init__(self, text):
        super().__init__()
        self.figures, self.attributes, self.tags, self.texts = {}, {}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags.append((tag, attrs))
        if "id" in attrs:
            self.attributes[attrs["id"]] = attrs
            if "data-value" in attrs:
                self.figures[attrs["id"]] = float(attrs["data-value"])

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self):
        return " ".join(self.texts)


def expected_figures(records):
    """What the page must say of these records, by other code than the report's."""
    pairs = [(r["ours"]["seconds"], r["stock"]["seconds"], r) for r in records if r["ours"] and r["stock"]]
    ours, stock = sorted(p[0] for p in pairs), sorted(p[1] for p in pairs)
    rank = -(-95 * len(pairs) // 100) - 1
    excused = sum(bool(r["difference"]["within_spread"]) for _, _, r in pairs)
    return {**({"num_excused": excused} if excused else {}), "ratio": statistics.median(o / s for o, s, _ in pairs), "median_ours": statistics.median(ours),
            "median_stock": statistics.median(stock), "total_ours": sum(ours), "total_stock": sum(stock),
            "ratio_total": sum(ours) / sum(stock), "p95_ours": ours[rank], "p95_stock": stock[rank], "max_ours": ours[-1],
            "max_stock": stock[-1], "num_faster": sum(o < s for o, s, _ in pairs), "num_solves": len(records),
            "num_alone": len(records) - len(pairs), "num_disagreeing": sum(bool(r["difference"]["violations"]) for _, _, r in pairs)}


class AbReportTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)
        self.log = self.folder / "run.jsonl"

    def run_tool(self, *arguments, code=0):
        result = subprocess.run([sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        return result

    def page(self, lines, broken=0):
        write(self.log, lines)
        result = self.run_tool(self.log)
        self.assertEqual(len(result.stderr.splitlines()), broken, result.stderr)
        text = (self.folder / "run.html").read_text(encoding="utf-8")
        self.absent(r"\b(nan|NaN|None|inf)\b", text)
        self.check_contained(text)
        return Page(text)

    def absent(self, pattern, text):
        found = re.search(pattern, text)
        self.assertIsNone(found, text[max(0, found.start() - 80):found.end() + 80] if found else "")

    def check_contained(self, text):
        """Nothing is fetched and nothing runs."""
        self.absent(r"https?://|url\(|@import|src=|<script|javascript:", text)
        for tag, attributes in Page(text).tags:
            self.assertFalse([name for name in attributes if name.startswith("on")], tag)
            self.assertTrue(attributes.get("href", "data:").startswith("data:"))

    def check_figures(self, page, records):
        expected = expected_figures(records)
        self.assertEqual(set(page.figures), set(expected))
        for name, value in expected.items():
            self.assertAlmostEqual(page.figures[name], value, delta=1e-12 * abs(value), msg=name)

    def test_the_figures_are_the_logs(self):
        records = window_run(300)
        page = self.page(records)
        self.check_figures(page, records)
        both = [(k, r) for k, r in enumerate(records, 1) if r["ours"]]
        slowest = sorted(both, key=lambda pair: -pair[1]["ours"]["seconds"])[:6]
        self.assertEqual(page.attributes["slowest"]["data-lines"], " ".join(str(k) for k, _ in slowest))
        dearest = sorted(both, key=lambda pair: -pair[1]["ours"]["seconds"] / pair[1]["stock"]["seconds"])[:6]
        self.assertEqual(page.attributes["dearest"]["data-lines"], " ".join(str(k) for k, _ in dearest))
        self.assertEqual(page.attributes["furthest"]["data-lines"].split()[0], "151")  # the violation
        self.assertIn("cost of iteration 3: ours 1234.5", page.text)
        self.assertIn("Example CPU @ 3.00 GHz", page.text)

    def test_the_pictures_show_every_solve(self):
        records = window_run(100)
        page = self.page(records)
        compared = sum(1 for record in records if record["ours"])
        kinds = [attributes.get("class", "") for tag, attributes in page.tags if tag == "circle"]
        # Twice each, for the wide and the narrow window: scatter and costs; and both curves of the timeline.
        self.assertEqual(sum(kind.startswith("point") for kind in kinds), 4 * compared)
        self.assertEqual(sum(kind.startswith("dot") for kind in kinds), 4 * compared)
        bars = [int(match) for match in re.findall(r"(?:inceres|Ceres): (\d+) solves of", page.text)]
        self.assertEqual(sum(bars), 4 * compared)

    def test_fallbacks_are_grouped_by_reason(self):
        lines = [line(k, None, fallback=f"bounds: parameter block 0x7f{k:x} of size 7 has some") for k in range(5)]
        lines += [line(9, None, fallback="minimizer_type LINE_SEARCH"), line(10)]
        page = self.page(lines)
        self.assertRegex(page.text, r"5\s+× bounds: parameter block 0x… of size N has some")
        self.assertRegex(page.text, r"1\s+× minimizer_type LINE_SEARCH")
        self.check_figures(page, lines)

    def test_an_empty_log(self):
        page = self.page([])
        self.assertIn("The log is empty", page.text)
        self.assertEqual(page.figures, {"num_solves": 0})

    def test_only_fallbacks(self):
        page = self.page([line(k, None, fallback="LINE_SEARCH") for k in range(3)])
        self.assertIn("nothing to compare", page.text)
        self.assertRegex(page.text, r"3\s+× LINE_SEARCH")

    def test_one_line(self):
        records = [line(0)]
        self.check_figures(self.page(records), records)

    def test_broken_lines_are_named_and_skipped(self):
        good = [line(0), line(1, 0.004)]
        cut = json.dumps(line(2))[:200]
        page = self.page([good[0], cut, "", "[1, 2]", '{"ours": null}', good[1], '{"ours": {"seconds": -1}, "stock": null}', "\x00\xff"], broken=5)
        self.check_figures(page, good)
        for number in (2, 4, 5, 7, 8):
            self.assertIn(f"line {number}:", page.text)
        page = self.page([cut], broken=1)
        self.assertIn("No line of the log could be read", page.text)

    def test_text_of_the_log_stays_text(self):
        evil = '<script>alert("x")</script><img src=x onerror=alert(1)>'
        record = line(0, violations=[evil])
        record["machine"]["cpu"] = evil
        record["ours"]["message"] = evil
        other = line(1, None, fallback=evil)
        write(self.log, [record, other])
        self.run_tool(self.log)
        text = (self.folder / "run.html").read_text(encoding="utf-8")
        self.absent("<script|<img", text)
        self.assertGreater(text.count("alert"), 2)

    def test_extremes(self):
        lines = [line(0, 1e-6, 1e3), line(1, 1e3, 1e-6, cost_difference=0.5), line(2, cost_difference=0.0), line(3, cost=0.0)]
        lines[1]["difference"]["cost"] = None  # not finite
        lines[1]["difference"]["parameter"] = None
        lines[2].pop("sizes")
        lines[3].pop("machine")
        lines[3]["function_tolerance"] = 1e-3
        page = self.page(lines)
        self.check_figures(page, lines)
        self.assertIn("not finite", page.text)
        same = [line(k, 0.002, 0.002, cost_difference=0.0) for k in range(4)]
        self.check_figures(self.page(same), same)

    def test_incremental_mode_and_missing_details(self):
        lines = [line(k) for k in range(3)]
        for record in lines:
            record["mode"] = "incremental"
            del record["ours"]["stages"]
        self.assertNotIn("Where our time goes", self.page(lines).text)

    def test_a_long_log_makes_a_page_that_loads(self):
        records = window_run(20000)
        self.check_figures(self.page(records), records)
        self.assertLess((self.folder / "run.html").stat().st_size, 4e6)

    def test_output_and_errors(self):
        write(self.log, [line(0)])
        self.run_tool(self.log, "--output", self.folder / "page.html")
        self.assertTrue((self.folder / "page.html").exists())
        self.assertIn("nowhere.jsonl", self.run_tool(self.folder / "nowhere.jsonl", code=1).stderr)
        self.assertIn("no/page.html", self.run_tool(self.log, "--output", self.folder / "no/page.html", code=1).stderr)
        log = self.log.read_bytes()
        for flags in (("--output", self.log), ("--json", self.log), ("--json", self.log.with_suffix(".html")),
                      ("--output", self.folder / "one", "--json", self.folder / "one")):
            self.assertIn("overwrite", self.run_tool(self.log, *flags, code=2).stderr)
        self.assertEqual(self.log.read_bytes(), log)
        self.run_tool(code=2)
        self.assertIn("--output", self.run_tool("--help").stdout)

    def test_a_log_that_inceres_wrote(self):
        environment = {**os.environ, "INCERES_AB_LOG": str(self.log), "INCERES_CROSS_CHECK": "keep=stock", "INCERES_MODE": "quick"}
        command = [WRITER, "--gtest_filter=Environment.ThatOfThisProcess"]
        result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(result.stderr.count('INCERES_MODE: "quick" means nothing here'), 1, result.stderr)
        records = [json.loads(text) for text in self.log.read_text(encoding="utf-8").splitlines()]
        self.assertEqual(len(records), 12)
        self.assertEqual({record["kept"] for record in records}, {"stock"})
        # The maker of the other logs writes what the solver writes.
        for made, written in ((line(0), records[0]), (line(0, None, fallback="x"), records[5])):
            self.assertEqual(set(made), set(written))
            for name in ("sizes", "machine", "stock", "difference", "ours"):
                self.assertEqual(set(made[name] or {}), set(written[name] or {}), name)
        self.run_tool(self.log)
        page = Page((self.folder / "run.html").read_text(encoding="utf-8"))
        self.check_figures(page, records)
        self.assertIn("minimizer_type LINE_SEARCH", page.text)
        self.assertIn("Where our time goes", page.text)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
