"""Write self-contained HTML pages: one file, no network, nothing half-written."""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from psafit.files import encodable, write_atomically
from psafit.report.style import figure_style


@dataclass(frozen=True)
class Picture:
    """A figure in the page: image, what is to be seen, what it means."""

    uri: str
    alt: str
    caption: str | Markup


_Item = TypeVar("_Item")


def first(items: Sequence[_Item], most: int = 24) -> Sequence[_Item]:
    """Items that get pictures of their own: all, or of very many the first."""
    return items[:most]


def worst(errors: Sequence[float]) -> list[int]:
    """Places of the groups that get pictures: all, or of very many the worst, in the order of the experiment."""
    return sorted(first(sorted(range(len(errors)), key=lambda i: -errors[i])))


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("psafit.report", "templates"),
        autoescape=True,  # measured data come with titles and file names that others wrote
        undefined=jinja2.StrictUndefined,  # a missing result is a bug, not an empty cell
        trim_blocks=True,
        lstrip_blocks=True,
    )
    css, js = (
        resources.files("psafit.report").joinpath(f"templates/{name}").read_text("utf-8")
        for name in ("style.css", "explore.js")
    )
    digest = base64.b64encode(hashlib.sha256(js.encode()).digest()).decode()
    # Our own files: the only text that is not escaped. The browser runs the script by its hash, and no other.
    environment.globals |= {"style_css": Markup(css), "explore_js": Markup(js), "explore_hash": f"sha256-{digest}"}
    return environment


def render(template: str, out_path: str | Path, **context: Any) -> Path:
    """Render a template of this package to one HTML file.

    The page is written next to its destination and moved there in one step, so that a reader never
    sees half a page and a failed report leaves the previous one in place.

    Parameters
    ----------
    template : str
        Name in `psafit/report/templates`, e.g. ``"reproduction.html.j2"``.
    out_path : path-like
        The HTML file; its folder is made if needed.
    **context
        What the template shows. Every page also takes ``provenance``, a mapping of label to text
        (version, seed, command, ...) for the footer.

    Returns
    -------
    Path
        Where the page is.

    Raises
    ------
    jinja2.UndefinedError
        If the template asks for something that the context lacks.
    """
    out_path = Path(out_path)
    text = _environment().get_template(template).render({"provenance": {}, **context})
    write_atomically(out_path, encodable(text).encode("utf-8"))
    return out_path


def _with_palette(png: io.BytesIO) -> io.BytesIO:
    """Reduce to 256 colours, which takes a drawing to about a third of its bytes."""
    from PIL import Image  # matplotlib's own writer of images

    small = io.BytesIO()
    with Image.open(png) as image:
        flat = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
        flat.save(small, format="png")
    return small


def figure_data_uri(figure: Figure, *, svg_limit: int = 120_000, like: int = 1, few: int = 8, dpi: int = 200) -> str:
    """Encode a figure for `<img src>`: SVG while it is small, else PNG.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Drawn inside `psafit.report.style.figure_style`.
    svg_limit : int, bytes
        Largest SVG to embed; 0 for PNG in any case.
    like, few : int
        Figures like this one on the page. Of more than a few each is a PNG, the smaller format.
    dpi : int
        Dots per inch of a PNG.

    Returns
    -------
    str
        ``data:image/...;base64,...``
    """
    buffer = io.BytesIO()
    with figure_style():
        kind = "svg+xml"
        if like > few:
            svg_limit = 0
        if svg_limit > 0:
            figure.savefig(buffer, format="svg", metadata={"Date": None})
        if svg_limit <= 0 or buffer.tell() > svg_limit:
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", dpi=dpi)
            buffer = _with_palette(buffer)
            kind = "png"
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
