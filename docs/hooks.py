"""What mkdocs and mkdocstrings do not do by themselves: equations without a script, units in docstrings, notebooks."""

from __future__ import annotations

import html
import re
from typing import Any

import griffe
from latex2mathml.converter import convert
from markdown import Extension, Markdown
from markdown.postprocessors import Postprocessor
from markdown.preprocessors import Preprocessor
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter

# What pymdownx.arithmatex leaves.
_LATEX = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)
# The dash before a description that is not there.
_DASH = re.compile(r'–(\s*<div class="doc-md-description">\s*</div>)')
_CELL, _LONG = re.compile(r"<td[^>]*>.*?</td>", flags=re.DOTALL), re.compile(r"(?<=<code>)[^<]{31,}(?=</code>)")
# The default that a function makes anew for each record.
_MADE = re.compile(r"^\(lambda: (.*)\)\(\)$", flags=re.DOTALL)
_FUNCTIONS = "sin|cos|tan|sech|arcsin|asinh|ln|exp|max|min|Re"
# The spaces TeX would set, and characters that browsers do not derive from an attribute.
_SETTING = (
    (
        re.compile(r"<mo[^>]*>(&#x0007C;|&#x0002F;|\.|&#x0002E;)</mo>"),
        r'<mo stretchy="false" lspace="0" rspace="0">\1</mo>',
    ),
    (re.compile(rf"(<m[io]>(?:{_FUNCTIONS})</m[io]>)(?!<mo[^>]*>&#x00028;)"), r'\1<mspace width="0.167em"/>'),
    (re.compile(rf"(</m\w+>)(<m[io]>(?:{_FUNCTIONS})</m[io]>)"), r'\1<mspace width="0.167em"/>\2'),
    (re.compile(r"<mi>&#x0007E;</mi>"), "<mo>&#x0223C;</mo>"),
    (re.compile(r'<mi mathvariant="script">N</mi>'), "<mi>&#x1D4A9;</mi>"),
)


def mathml(latex: str, *, block: bool) -> str:
    """Translate LaTeX."""
    text = convert(latex.strip(), display="block" if block else "inline")
    for pattern, better in _SETTING:
        text = pattern.sub(better, text)
    return f'<div class="math">{text}</div>' if block else text


class RestMath(Preprocessor):
    """The mathematics of docstrings, which are reStructuredText there."""

    def run(self, lines: list[str]) -> list[str]:
        blocks = "\n".join(lines).split("\n\n")
        for i, block in enumerate(blocks):
            if block.lstrip("\n").startswith(".. math::"):
                inner = block.lstrip("\n").removeprefix(".. math::").splitlines()
                blocks[i] = "\n".join(["$$", *filter(None, map(str.strip, inner)), "$$"])
        text = "\n\n".join(blocks)
        return re.sub(r":math:`([^`]+)`", lambda m: f"${' '.join(m[1].split())}$", text).split("\n")


class MathML(Postprocessor):
    """LaTeX out, MathML in."""

    def run(self, text: str) -> str:
        return _LATEX.sub(lambda m: mathml(html.unescape(m[3]), block=m[2] == "["), text)


class Mathematics(Extension):
    """Both of them."""

    def extendMarkdown(self, md: Markdown) -> None:
        md.preprocessors.register(RestMath(md), "rest-math", 24)  # fenced code has been taken out at 25
        md.postprocessors.register(MathML(md), "mathml", 0)  # everything has been put back


class Docstrings(griffe.Extension):
    """Types and defaults as they were written.

    griffe takes types such as "array, m/s" for tuples and quotients. Of names that share a line it takes the first
    one's default for all, and its type where the line has none.
    """

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        own = {p.name: p for p in obj.parameters} if isinstance(obj, griffe.Class | griffe.Function) else {}
        for parameter in own.values():
            if made := _MADE.match(str(parameter.default)):
                parameter.default = made[1]
        for section in obj.docstring.parsed if obj.docstring else ():
            if section.kind.value not in ("parameters", "returns"):
                continue
            for item in section.value:
                said = item.annotation
                if isinstance(said, griffe.ExprTuple | griffe.ExprBinOp) and getattr(said, "operator", "") != "|":
                    item.annotation = str(said).strip("()").replace(" / ", "/").replace(" - ", "-").replace(" ^ ", "^")
                if section.kind.value == "parameters" and item.name in own:
                    item.value = own[item.name].default
                    if any(said is parameter.annotation for parameter in own.values()):
                        item.annotation = own[item.name].annotation


class Notebook(File):
    """A notebook as a page: what is stored in it, as Markdown and pictures."""

    def is_documentation_page(self) -> bool:
        return True


def on_files(files: Files, /, *, config: Any) -> Files:
    """Notebooks become pages; the pictures in them become files."""
    for file in [f for f in files if f.src_uri.endswith(".ipynb")]:
        files.remove(file)
        page = Notebook(file.src_uri, config.docs_dir, config.site_dir, use_directory_urls=False)
        settings = {"output_files_dir": page.name, "unique_key": page.name}
        page.content_string, found = MarkdownExporter().from_filename(page.abs_src_path, resources=settings)
        files.append(page)
        folder = page.src_uri.rpartition("/")[0]
        for name, content in found["outputs"].items():
            files.append(File.generated(config, f"{folder}/{name}", content=content))
    return files


def on_config(config: Any) -> Any:
    """Join the Markdown extensions of mkdocs.yml."""
    config.markdown_extensions.append(Mathematics())
    return config


def on_page_content(content: str, /, **_: Any) -> str:
    """Tidy what mkdocstrings wrote; long names in tables may be broken at their underscores."""
    content = _DASH.sub(r"\1", content)
    return _CELL.sub(lambda cell: _LONG.sub(lambda name: name[0].replace("_", "_<wbr>"), cell[0]), content)
