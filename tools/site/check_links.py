#!/usr/bin/env python3
"""Checks that every link inside a folder of HTML pages leads somewhere, anchors included.

    check_links.py FOLDER         one line per dead link (page: target); exit with 1 if there is any
    check_links.py --self_test    plant one dead link of each kind and see that it is reported

Looked at are href and src of all elements. Links to other sites are counted and not followed: the
check needs no network. A link that begins with / is an error, for the site must work wherever it
lies.
"""

import html.parser
import pathlib
import sys
import tempfile
import urllib.parse


class Page(html.parser.HTMLParser):
    """The links of a page, and the anchors it has."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.links = []
        self.anchors = {"", "top"}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        canonical = tag == "link" and ("rel", "canonical") in attributes
        for name, value in attributes:
            if name in ("href", "src") and value is not None and not canonical:
                self.links.append(value)
            elif name == "id" or (name == "name" and tag == "a"):
                self.anchors.add(value)

    handle_startendtag = handle_starttag


class Site:
    """All pages below a folder."""

    def __init__(self, folder):
        self.folder = folder.resolve()
        self.pages = {path.resolve(): Page(path.read_text(encoding="utf-8"))
                      for path in sorted(folder.rglob("*.html"))}
        self.problems = []
        self.num_links = self.num_external = 0

    def check(self):
        for path, page in self.pages.items():
            for link in page.links:
                self.num_links += 1
                problem = self.problem_of(path, link)
                if problem:
                    self.problems.append(f"{path.relative_to(self.folder)}: {link}: {problem}")
        if not self.pages:
            self.problems.append(f"{self.folder}: no pages")
        return self.problems

    def problem_of(self, path, link):
        """Why the link is dead, or nothing."""
        parts = urllib.parse.urlsplit(link)
        if parts.scheme or parts.netloc:
            self.num_external += 1
            return None
        if parts.path.startswith("/"):
            return "begins with /"
        target = path
        if parts.path:
            target = (path.parent / urllib.parse.unquote(parts.path)).resolve()
        if target.is_dir():
            target = target / "index.html"
        if not target.is_relative_to(self.folder):
            return "is outside of the site"
        if not target.is_file():
            return "there is no such file"
        anchor = urllib.parse.unquote(parts.fragment)
        if target in self.pages and anchor not in self.pages[target].anchors:
            return "the page has no such anchor"
        return None


CLEAN = {
    "index.html": '<a href="a/b.html#there">b</a> <img src="a/x.svg">'
                  '<a href="#here" id="here">h</a>'
                  '<a href="https://example.org">e</a>',
    "a/b.html": '<h2 id="there">There</h2> <a href="../index.html">back</a>',
    "a/x.svg": "<svg/>",
}
VIOLATIONS = [
    ("b.html#there", "c.html", "no such file"),
    ("#there", "#nowhere", "no such anchor"),
    ("#here", "#gone", "no such anchor"),
    ("a/x.svg", "/a/x.svg", "begins with /"),
    ("a/b.html", "../b.html", "outside of the site"),
]


def problems_of(files):
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            path = pathlib.Path(folder, name)
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return Site(pathlib.Path(folder)).check()


def self_test():
    failures = [f"the clean site: {problem}" for problem in problems_of(CLEAN)]
    for old, new, message in VIOLATIONS:
        assert old in CLEAN["index.html"], old
        problems = problems_of({**CLEAN, "index.html": CLEAN["index.html"].replace(old, new, 1)})
        if not any(message in problem for problem in problems):
            failures.append(f"{new} for {old}: {problems or 'nothing'} was reported")
    if not problems_of({}):
        failures.append("an empty folder is taken for a site")
    print("\n".join(failures) or f"{len(VIOLATIONS)} planted dead links are reported")
    return 1 if failures else 0


def main(arguments):
    if arguments == ["--self_test"]:
        return self_test()
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    site = Site(pathlib.Path(arguments[0]))
    problems = site.check()
    print("\n".join(problems), file=sys.stderr, end="\n" if problems else "")
    print(f"check_links: {len(site.pages)} pages, {site.num_links} links ({site.num_external} to "
          f"other sites, not followed), {len(problems)} broken")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
