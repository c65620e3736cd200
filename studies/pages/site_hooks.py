"""Hooks for MkDocs: pages from outside ``docs/``, links to sources, and formulas.

The same Markdown is read on a forge, where a link like ``../envs/channel.py`` leads to the file.
The site has a page of its own for every file linked in this way. So it works without the
repository's address, and shows the version of the code for which the documentation was written.
"""

import html
import json
import posixpath
import re
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from orchid_uav.experiments.replay.page.page import page_html

ROOT = Path(__file__).parents[2]
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}
"""Files of the repository's root that become pages, and their paths on the site."""
SOURCES = "source"
FLIGHT = "flight.html"
"""The replay that docs/replay.md shows in a frame."""
FONT = "STIXTwoMath-Regular.ttf"
"""A font for formulas, since few systems have one; its licence is the OFL."""
_LANGUAGES = {
    ".py": "python",
    ".sbatch": "bash",
    ".toml": "toml",
    ".json": "json",
    ".cff": "yaml",
    ".yml": "yaml",
}
_FENCED = re.compile(r"^(```|~~~).*?^\1[ \t]*$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?<=\]\()(?P<path>[^)\s#]+)(?P<anchor>#[^)\s]*)?(?=\))")
_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\[(\[](?P<tex>.*?)\\[)\]]</(?P=tag)>', re.DOTALL
)
_logger = get_plugin_logger("orchid")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the root, of linked files and directories, a replay, and the font."""
    font = Path(find_spec("ziamath").origin).parent / "fonts" / FONT
    files.append(File.generated(config, FONT, abs_src_path=str(font)))
    files.append(File.generated(config, FLIGHT, content=_flight_page()))
    for path, uri in PAGES.items():
        files.append(File.generated(config, uri, abs_src_path=str(ROOT / path)))
    for page in list(files.documentation_pages()):
        for target in _targets(page.content_string, page.src_uri):
            uri = _site_uri(target)
            if uri and uri.startswith(f"{SOURCES}/") and files.get_file_from_path(uri) is None:
                files.append(File.generated(config, uri, content=_source_page(target)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links to the places of their targets within the site."""
    uri = page.file.src_uri
    if uri.startswith(f"{SOURCES}/"):
        return markdown

    def here(link: re.Match[str]) -> str:
        target = _site_uri(_repository_path(link["path"], uri))
        if target is None or files.get_file_from_path(target) is None:
            return link[0]  # an external address, or a dead link, which MkDocs reports
        return posixpath.relpath(target, posixpath.dirname(uri)) + (link["anchor"] or "")

    return _outside_code(markdown, lambda text: _LINK.sub(here, text))


def on_page_content(content: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Typeset formulas as MathML, which browsers show without a script."""

    def typeset(found: re.Match[str]) -> str:
        tex = html.unescape(found["tex"]).strip()
        display = "block" if found["tag"] == "div" else "inline"
        try:
            formula = convert(tex, display=display)
        except Exception as error:  # latex2mathml's errors have no common base class
            _logger.warning("%s: cannot typeset '%s': %r", page.file.src_uri, tex, error)
            return found[0]
        # latex2mathml passes unknown commands on as text. Of the variants of letters, browsers
        # know only the upright one.
        if "\\" in formula or re.search('mathvariant="(?!normal")', formula):
            _logger.warning("%s: unknown command in '%s'", page.file.src_uri, tex)
        return f'<{found["tag"]} class="formula">{formula}</{found["tag"]}>'

    return _FORMULA.sub(typeset, content)


def _flight_page() -> str:
    """The page of the replay that ``studies.flight`` recorded, as ``orchid replay`` writes it."""
    recorded = ROOT / "studies" / "results" / "flight.json"
    document = json.loads(recorded.read_text(encoding="utf-8"))["replay"]
    return page_html(json.dumps(document, ensure_ascii=False), document["title"])


def _outside_code(markdown: str, change: Callable[[str], str]) -> str:
    parts, end = [], 0
    for block in _FENCED.finditer(markdown):
        parts += [change(markdown[end : block.start()]), block[0]]
        end = block.end()
    return "".join([*parts, change(markdown[end:])])


def _targets(markdown: str, uri: str) -> Iterator[str]:
    """Paths in the repository to which a page links."""
    for link in _LINK.finditer(_FENCED.sub("", markdown)):
        if path := _repository_path(link["path"], uri):
            yield path


def _repository_path(link: str, uri: str) -> str:
    """The target of a page's relative link, as a path from the root; empty for other links."""
    if ":" in link or link.startswith("/"):
        return ""
    own = next((path for path, page in PAGES.items() if page == uri), f"docs/{uri}")
    path = posixpath.normpath(posixpath.join(posixpath.dirname(own), link))
    return "" if path.startswith("..") else path


def _site_uri(path: str) -> str | None:
    """The page or file of the site for a path of the repository; None if there is no such path."""
    if not path or not (ROOT / path).exists():
        return None
    if path in PAGES:
        return PAGES[path]
    if path.startswith("docs/") and not path.endswith(".py"):
        return path.removeprefix("docs/")
    return f"{SOURCES}/{path}.md"


def _source_page(path: str) -> str:
    """A page that shows a file, or the names of a directory's files."""
    head = f"---\nhide: [toc]\nsearch:\n  exclude: true\n---\n\n# {path}\n\n"
    place = ROOT / path
    if place.is_dir():
        hidden = (".", "__pycache__")
        names = [
            f"{entry.name}/" if entry.is_dir() else entry.name
            for entry in sorted(place.iterdir())
            if not entry.name.startswith(hidden)
        ]
        return head + "\n".join(f"* `{name}`" for name in names) + "\n"
    text = place.read_text(encoding="utf-8").rstrip("\n")
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{head}{fence}{_LANGUAGES.get(place.suffix, 'text')}\n{text}\n{fence}\n"
