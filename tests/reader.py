"""A page, read back, and a title that tries to break it."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from importlib import resources

HOSTILE = "<script>alert(1)</script> </style> \"quoted\" 'single' & {{ 7 * 7 }} $x_"


SCRIPT = resources.files("psafit.report").joinpath("templates/explore.js").read_text("utf-8")
"""The one script of a page."""


class Reader(HTMLParser):
    """Tags with their attributes, and the text between them."""

    def __init__(self, html: str):
        super().__init__(convert_charrefs=True)
        self.html = html
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self._hidden = 0
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._hidden += tag in ("style", "script")

    def handle_endtag(self, tag):
        self._hidden -= tag in ("style", "script")

    def handle_data(self, data):
        if not self._hidden:
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.texts).replace("\xa0", " ").split())

    @property
    def headings(self) -> list[str]:
        return re.findall(r"<h2[^>]*>([^<]*)</h2>", self.html)

    @property
    def first_screen(self) -> str:
        return Reader(self.html[self.html.index('class="summary"') : self.html.index("<h2")]).text

    @property
    def foreign(self) -> str:
        """The page without its images and its own script."""
        return re.sub(r"data:image/[^\"]*", "", self.html.replace(f"<script>{SCRIPT}</script>", "", 1))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attrs for name, attrs in self.tags if name == tag]
