"""One HTML page that holds all results: no file beside it, nothing from the network."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

if TYPE_CHECKING:
    import pandas as pd

SCREEN = 0.55
"""Pixels of a page for each of a picture, whose width stands in bytes 16 to 20 of a PNG."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem;
  color: #1a1a1a; background: #fff; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13px; display: block;
  overflow-x: auto; }
th, td { border-bottom: 1px solid #ddd; padding: .2rem .7rem; text-align: right;
  overflow-wrap: anywhere; }
th { text-align: left; } td.text { text-align: left; }
figure { display: inline-block; margin: .5rem; vertical-align: top; }
figure img { max-width: 100%; height: auto; } figcaption { color: #555; font-size: 13px; }
pre { background: #f6f6f6; padding: 1rem; overflow-x: auto; font-size: 13px; }
"""


def page(title: str, parts: Sequence[str]) -> str:
    """The text of a page of parts that are HTML."""
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    body = f"<h1>{escape(title)}</h1>" + "\n".join(parts)
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def facts(rows: Mapping[str, object]) -> str:
    """A table of names and values."""
    names = [escape(name.replace("_", " ")) for name in rows]
    values = [escape(str(value)) for value in rows.values()]
    cells = [
        f'<tr><th>{name}</th><td class="text">{value}</td></tr>'
        for name, value in zip(names, values, strict=True)
    ]
    return f"<table>{''.join(cells)}</table>"


def picture(path: Path) -> str:
    """A picture with its name below, held by the page itself."""
    content = path.read_bytes()
    data = base64.b64encode(content).decode("ascii")
    name = escape(path.stem.replace("_", " "))
    width = round(int.from_bytes(content[16:20], "big") * SCREEN)
    image = f'<img alt="{name}" width="{width}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{name}</figcaption></figure>"


def table(title: str, frame: "pd.DataFrame", rows: int) -> str:
    """The first rows of a data frame below a heading."""
    shown = frame.head(rows).to_html(float_format="{:.5g}".format, border=0)
    more = f"<p>{rows} of {len(frame)} rows</p>" if len(frame) > rows else ""
    return f"<h2>{escape(title)}</h2>{shown}{more}"


def text(title: str, content: str) -> str:
    """A text as it is, below a heading."""
    return f"<h2>{escape(title)}</h2><pre>{escape(content)}</pre>"


def links(title: str, names: Sequence[str]) -> str:
    """Files beside the page."""
    items = "".join(f'<li><a href="{quote(name)}">{escape(name)}</a></li>' for name in names)
    return f"<h2>{escape(title)}</h2><ul>{items}</ul>"
