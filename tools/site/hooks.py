"""What the site needs beside what MkDocs does by itself; mkdocs.yml names this file as its hooks.

The pages are Markdown that also works on a forge: links go to files of the repository. Here
- a link to a page of the site becomes one to that page, whatever folder the page comes from;
- a link to a public header leads to its page in the reference, where docs/build.sh has made one;
- a link to any other file leads to a copy of it in the site, below source/;
- a link to nothing is a warning, which --strict makes an error. So is a page without an entry in
  the navigation, and a list that Python-Markdown, unlike a forge, takes for a paragraph. An entry
  without its page is left out.
Headings get the anchors that a forge gives them, and flow charts written for Mermaid become
pictures by graphviz.
"""

import html
import logging
import pathlib
import posixpath
import re
import subprocess
import xml.etree.ElementTree as ElementTree

from mkdocs.structure.files import File
from pygments.formatters import HtmlFormatter

LOG = logging.getLogger("mkdocs.hooks.inceres")
ROOT = pathlib.Path(__file__).resolve().parents[2]
ROOT_PAGES = tuple(f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY"))
INCLUDE_FOLDERS = ("include/", "adapters/ceres/include/")

CODE = re.compile(r"(^```.*?^```[^\n]*$|^~~~.*?^~~~[^\n]*$|`[^`\n]+`)", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(?<=\]\()([^)\s]+)(?=(?:\s+\"[^\"]*\")?\))")
ATTRIBUTE = re.compile(r"(?<=\s)((?:href|src)=\")([^\"]+)(?=\")")
TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
TABLE_CODE = re.compile(r"(?<=<code>)[^<]*(?=</code>)")
MERMAID = re.compile(r"^```mermaid\n(.*?)^```$", re.DOTALL | re.MULTILINE)
MERGED_LIST = re.compile(r"^(?![ \t]*(?:[-*+]|\d+\.) |[ \t]*[|#>]|<|    )\S.*\n(?:[-*+]|\d+\.) .*",
                         re.MULTILINE)

reference = {}  # header, as programs include it: its page in the reference
copied = set()  # files of the repository that some page links to
diagrams = []


def anchor_of(heading, separator="-"):
    """As a forge makes it: lower case, spaces to hyphens, no punctuation."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", separator)


def headers_in_reference(tag_file):
    pages = {}
    for compound in ElementTree.parse(tag_file).getroot().iter("compound"):
        if compound.get("kind") == "file":
            path = compound.findtext("path") + compound.findtext("name")
            name = path.rpartition("/inceres/")[2] if "/inceres/" in path else path
            name = "inceres/" + name.removeprefix("inceres/")
            page = compound.findtext("filename")
            pages[name] = page if page.endswith(".html") else page + ".html"
    return pages


def without_missing(entries):
    """The navigation's entries whose pages are there; a glob stands for the pages it finds."""
    kept = []
    for entry in entries:
        (title, target), = entry.items() if isinstance(entry, dict) else [(None, entry)]
        if isinstance(target, list):
            inner = without_missing(target)
            kept += [{title: inner}] if inner else []
        elif "*" in target:
            kept += sorted(path.relative_to(ROOT / "docs").as_posix()
                           for path in (ROOT / "docs").glob(target))
        elif (ROOT / "docs" / target).is_file() or (ROOT / target).is_file():
            kept.append(entry)
        else:
            LOG.info("%s is not there yet: left out of the navigation", target)
    return kept


def on_config(config):
    reference.clear()
    copied.clear()
    diagrams.clear()
    if config["extra"]["reference"]:
        reference.update(headers_in_reference(config["extra"]["reference"]))
    config["mdx_configs"].setdefault("toc", {})["slugify"] = anchor_of
    config["nav"] = without_missing(config["nav"])
    return config


def on_files(files, config):
    for file in list(files):
        if file.src_path.endswith((".py", ".sh")):
            files.remove(file)
    for name in ROOT_PAGES:
        if (ROOT / name).is_file() and files.get_file_from_path(name) is None:
            files.append(File(name, str(ROOT), config["site_dir"], config["use_directory_urls"]))
    return files


def on_nav(nav, config, files):
    listed = {page.file.src_path for page in nav.pages}
    for file in files.documentation_pages():
        if file.src_path not in listed:
            LOG.warning("%s has no entry in the navigation of mkdocs.yml", file.src_path)
    return nav


def place_of(source):
    """Where a page of the site lies in the repository."""
    return source if source in ROOT_PAGES else "docs/" + source


class Rewriter:
    """Makes links between files of the repository links between pages of the site."""

    def __init__(self, page, files):
        self.source = page.file.src_path
        self.url = page.url
        self.files = {place_of(file.src_path): file for file in files}

    def file_of(self, path):
        """The repository's file that a link leads to; None: not a link to a file."""
        if re.match(r"[a-z][a-z0-9+.-]*:|//|#", path):
            return None
        return posixpath.normpath(posixpath.join(posixpath.dirname(place_of(self.source)), path))

    def in_site(self, target):
        """The same link from the built page, or None: it stays as it is."""
        path, hash_sign, anchor = target.partition("#")
        file = self.file_of(path) if path else None
        if file is None:
            return None
        if file in self.files:
            return self.from_here(self.files[file].url) + hash_sign + anchor
        return self.from_here(self.other_file(file, target)) if file != ".." else None

    def other_file(self, file, target):
        header = next((file[len(folder):] for folder in INCLUDE_FOLDERS if file.startswith(folder)),
                      None)
        if header in reference:
            return "reference/" + reference[header]
        if not (ROOT / file).is_file():
            LOG.warning("%s: the link to %s leads to no file", self.source, target)
            return "index.html"
        copied.add(file)
        return f"source/{file}.txt"

    def from_here(self, url):
        return posixpath.relpath(url, posixpath.dirname(self.url) or ".")

    def markdown_link(self, match):
        target = match.group(1)
        file = self.file_of(target.partition("#")[0])
        if file in self.files:  # MkDocs checks and turns those itself
            source = posixpath.relpath(self.files[file].src_path,
                                       posixpath.dirname(self.source) or ".")
            return source + target[len(target.partition("#")[0]):]
        link = self.in_site(target)
        return target if link is None else "site:" + link

    def attribute(self, match):
        return match.group(1) + (self.in_site(match.group(2)) or match.group(2))


def on_page_markdown(markdown, page, config, files):
    rewriter = Rewriter(page, files)

    def draw(match):
        diagrams.append(picture_of(match.group(1), page.file.src_path))
        return f'<div class="diagram" id="diagram-{len(diagrams)}"></div>'

    parts = CODE.split(MERMAID.sub(draw, markdown))
    for match in MERGED_LIST.finditer("".join("`code`" if i % 2 else part
                                              for i, part in enumerate(parts))):
        LOG.warning("%s: no empty line before the list at: %s", page.file.src_path,
                    match.group().splitlines()[1][:60])
    for i in range(0, len(parts), 2):  # what lies between is code
        parts[i] = ATTRIBUTE.sub(rewriter.attribute, LINK.sub(rewriter.markdown_link, parts[i]))
    return "".join(parts)


def on_page_content(html_text, page, config, files):
    html_text = html_text.replace('="site:', '="')
    for number, svg in enumerate(diagrams, 1):
        html_text = html_text.replace(f'id="diagram-{number}">', f'id="diagram-{number}">{svg}')
    return TABLE.sub(lambda match: f'<div class="wide">{breakable(match.group())}</div>', html_text)


def breakable(table):
    """A table whose long names may go on in the next line; wider than the page it scrolls."""
    return TABLE_CODE.sub(lambda match: re.sub(r"(_|::|(?<=[a-z][a-z])(?=[A-Z]))", r"\1<wbr>",
                                               match.group()), table)


def on_post_build(config):
    site = pathlib.Path(config["site_dir"])
    (site / "404.html").unlink(missing_ok=True)  # its links need a server
    # Debian's theme has jQuery under another name than the one that its pages ask for.
    wanted = site / "js" / "jquery-3.6.0.min.js"
    for jquery in ([] if wanted.exists() else (site / "js").glob("jquery-*.js")):
        jquery.rename(wanted)
    style = HtmlFormatter(style="default").get_style_defs(".codehilite")
    (site / "highlight.css").write_text(style + "\n", encoding="utf-8")
    for file in sorted(copied):
        copy = site / "source" / (file + ".txt")
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes((ROOT / file).read_bytes())


def dot_of(chart, source):
    """A flow chart of boxes, arrows and frames around boxes, as graphviz takes it."""
    lines = ["digraph {", 'rankdir=BT; node [shape=box, style="rounded,filled", fillcolor=white,',
             "fontname=sans, fontsize=11]; edge [arrowsize=0.7];"]
    for line in chart.splitlines():
        words = line.strip()
        if frame := re.fullmatch(r"subgraph (\w+) \[(.*)\]", words):
            lines += [f"subgraph cluster_{frame[1]} {{", f'label="{frame[2]}"; fontname=sans;',
                      'fontsize=11; style="rounded"; color=gray;']
        elif re.fullmatch(r"\w+ --> \w+", words):
            lines.append(words.replace("-->", "->") + ";")
        elif re.fullmatch(r"\w+", words):
            lines.append("}" if words == "end" else words + ";")
        elif words and words != "flowchart BT":
            LOG.warning("%s: the flow chart's line is not understood: %s", source, words)
    return "\n".join(lines + ["}"])


def picture_of(chart, source):
    try:
        drawn = subprocess.run(["dot", "-Tsvg"], input=dot_of(chart, source), text=True,
                               capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        LOG.warning("%s: dot of graphviz draws the flow chart, and failed: %s", source, error)
        return f"<pre>{html.escape(chart)}</pre>"
    return drawn[drawn.index("<svg"):]
