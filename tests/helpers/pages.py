"""Pages of HTML, taken apart and opened."""

import shutil
from html.parser import HTMLParser

VOID = {"meta", "input", "br", "img"}
HOSTILE = '</script><script>alert(1)</script><b onclick="x">&amp;\U0001f681\u202eabc\x00\ud800\'"'
"""A text that tries to become more than a text."""
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
"""A browser, where there is one."""


class Page(HTMLParser):
    """Elements with their attributes, and texts, of a page that is nested well."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.texts, self.open = [], [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        assert len(dict(attributes)) == len(attributes), f"an attribute of {tag} comes twice"
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.texts.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def text(self):
        return "".join(self.texts)
