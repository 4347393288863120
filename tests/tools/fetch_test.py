"""fetch_test.py BAL_DATA: bal_data/fetch.sh against a local server."""

import bz2
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from range_server import RangeServer  # noqa: E402  (must not leave byte code in the source tree)

BAL_DATA = sys.argv.pop(1)
PATH = "/ladybug/problem-49-7776-pre.txt.bz2"
NAME = "ladybug-problem-49-7776-pre.txt.bz2"
CONTENT = bz2.compress(os.urandom(150000))  # random: does not shrink, so that there is something to resume


class FetchTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.mkdtemp()
        shutil.copy(os.path.join(BAL_DATA, "fetch.sh"), self.directory)
        self.public = os.path.join(self.directory, "public")
        self.file = os.path.join(self.public, NAME)
        self.checksums = os.path.join(self.directory, "checksums.sha256")
        self.server = RangeServer()
        self.server.files[PATH] = CONTENT

    def tearDown(self):
        self.server.close()
        shutil.rmtree(self.directory)

    def fetch(self, *arguments, url=None):
        environment = dict(os.environ, INCERES_BAL_BASE_URL=url or self.server.url, no_proxy="127.0.0.1")
        return subprocess.run(
            ["sh", os.path.join(self.directory, "fetch.sh"), *arguments], env=environment, capture_output=True, text=True, timeout=60
        )

    def expect_success(self, *arguments):
        result = self.fetch(*arguments)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        return result

    def expect_failure(self, text, *arguments, url=None):
        result = self.fetch(*arguments, url=url)
        self.assertNotEqual(result.returncode, 0, result.stdout)
        self.assertIn(text, result.stderr)
        return result

    def expect_file(self):
        with open(self.file, "rb") as file:
            self.assertEqual(file.read(), CONTENT)
        self.assertFalse(os.path.exists(self.file + ".part"))

    def put(self, path, content):
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as file:
            file.write(content)

    def record(self, content):
        with open(self.checksums, "w") as file:
            file.write("%s  %s\n" % (hashlib.sha256(content).hexdigest(), NAME))

    def test_full_download_records_the_checksum(self):
        self.expect_success("ladybug-49")
        self.expect_file()
        with open(self.checksums) as file:
            self.assertEqual(file.read(), "%s  %s\n" % (hashlib.sha256(CONTENT).hexdigest(), NAME))

    def test_full_name_and_second_run(self):
        self.expect_success("ladybug-49-7776")
        requests = len(self.server.requests)
        self.assertIn("already here, checksum right", self.expect_success("ladybug-49").stdout)
        self.assertEqual(len(self.server.requests), requests, "nothing is downloaded twice")

    def test_several_problems(self):
        self.server.files["/final/problem-93-61203-pre.txt.bz2"] = CONTENT
        self.expect_success("ladybug-49", "final-93")
        self.assertTrue(os.path.exists(os.path.join(self.public, "final-problem-93-61203-pre.txt.bz2")))

    def test_resumes_a_broken_download(self):
        self.server.break_off_after = 60000
        self.expect_failure("the same command resumes it", "ladybug-49")
        self.assertFalse(os.path.exists(self.file))
        self.assertEqual(os.path.getsize(self.file + ".part"), 60000)
        self.assertFalse(os.path.exists(self.checksums), "nothing is recorded of half a file")
        self.expect_success("ladybug-49")
        self.assertEqual(self.server.requests[-1], (PATH, "bytes=60000-"))
        self.expect_file()

    def test_partial_file_that_is_complete(self):
        self.put(self.file + ".part", CONTENT)
        self.expect_success("ladybug-49")
        self.expect_file()

    def test_server_that_cannot_resume(self):
        self.server.supports_ranges = False
        self.put(self.file + ".part", CONTENT[:1000])
        self.assertIn("cannot resume, starting again", self.expect_success("ladybug-49").stderr)
        self.expect_file()

    def test_other_content_than_recorded_is_refused(self):
        self.record(b"what it once was")
        self.expect_failure("checksum", "ladybug-49")
        self.assertEqual(os.listdir(self.public), [], "what is wrong is removed")

    def test_damaged_partial_file_is_refused_then_repaired(self):
        self.record(CONTENT)
        self.put(self.file + ".part", b"x" * 1000)
        self.expect_failure("checksum", "ladybug-49")
        self.expect_success("ladybug-49")
        self.expect_file()

    def test_file_damaged_on_disk_is_noticed(self):
        self.expect_success("ladybug-49")
        self.put(self.file, CONTENT[:-1])
        self.expect_failure("does not have the recorded checksum", "ladybug-49")

    def test_first_download_must_be_bzip2(self):
        self.server.files[PATH] = b"<html>please log in</html>"
        self.expect_failure("damaged", "ladybug-49")
        self.assertFalse(os.path.exists(self.checksums))

    @unittest.skipUnless(shutil.which("bzip2"), "needs bzip2")
    def test_first_download_must_be_whole(self):
        self.server.files[PATH] = CONTENT[:100000]
        self.expect_failure("damaged", "ladybug-49")
        self.assertFalse(os.path.exists(self.checksums))

    def test_unknown_names(self):
        for name in ("ladybug-50", "atlantis-49", "ladybug-49-7777", "ladybug", "../x-1", ""):
            self.expect_failure("no problem '%s'; fetch.sh --list prints the names" % name, "ladybug-73", name)
        self.assertEqual(self.server.requests, [], "names are checked before anything is downloaded")

    def test_missing_on_the_server(self):
        self.expect_failure("404", "ladybug-73")
        self.assertFalse(os.path.exists(self.checksums))

    def test_no_server(self):
        self.expect_failure("download failed", "ladybug-49", url="http://127.0.0.1:9")

    def test_list_and_help(self):
        names = self.expect_success("--list").stdout.split()
        self.assertEqual(len(names), 98)
        self.assertEqual(len(set(names)), 98)
        self.assertIn("final-13682-4456117", names)
        self.assertIn("usage: fetch.sh NAME", self.expect_success("--help").stdout)
        self.assertEqual(self.fetch().returncode, 2)


if __name__ == "__main__":
    unittest.main()
