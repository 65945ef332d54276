"""Small pieces of HTML. Every text that comes in is escaped; only what these functions return
counts as markup.
"""

import base64
from collections.abc import Sequence
from html import escape
from importlib.resources import files

import cv2
import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure

from breastscan.report.catalogue import HOLDS
from breastscan.report.theme import to_svg

PICTURE_WIDTH_PX = 800
JPEG_QUALITY = 82


def document(title: str, blocks: Sequence[str], scripts: str = "") -> str:
    """A whole page in the house's style; `blocks` are markup, and `scripts` come last, so that
    everything else is shown at once.
    """
    style = files("breastscan.report").joinpath("page.css").read_text(encoding="utf-8")
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>",
            *blocks,
            f"</main>\n{scripts}\n</body>\n</html>\n",
        ]
    )


def section(title: str, *blocks: str) -> str:
    """A part of the page under a heading; `blocks` are markup."""
    return (
        f"<section>\n<h2>{escape(title)}</h2>\n"
        + "\n".join(block for block in blocks if block)
        + "\n</section>"
    )


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def preformatted(text: str) -> str:
    """Text whose lines and spaces stay as they are."""
    return f"<pre>{escape(text)}</pre>"


def captioned(content: str, caption: str) -> str:
    """Any markup with a caption under it."""
    return f"<figure>\n{content}\n<figcaption>{escape(caption)}</figcaption>\n</figure>"


def card(value: str, unit: str, label: str, bar: str, verdict: str) -> str:
    """One number set large, with what it is and the bar that it is held to underneath."""
    judged = f'<span class="bar">{escape(bar)} {_verdict(verdict)}</span>' if bar else ""
    return (
        f'<div class="card"><span class="value">{escape(value)}</span> '
        f'<span class="unit">{escape(unit)}</span>'
        f'<span class="label">{escape(label)}</span>{judged}</div>'
    )


def pairs(rows: Sequence[tuple[str, str]]) -> str:
    """Names and what stands for them, as a list; nothing where there are none."""
    entries = "\n".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in rows)
    return f'<dl class="origin">\n{entries}\n</dl>' if rows else ""


def drawing(figure: Figure, description: str, caption: str) -> str:
    """A drawn figure as inline SVG."""
    return captioned(f'<div class="drawing">{to_svg(figure, description)}</div>', caption)


def picture(image: UInt8[np.ndarray, "h w 3"], description: str) -> str:
    """A camera picture, reduced to what the page can show and embedded as JPEG."""
    height = round(image.shape[0] * PICTURE_WIDTH_PX / image.shape[1])
    reduced = cv2.resize(image, (PICTURE_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", reduced, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    data = base64.b64encode(jpeg.tobytes()).decode("ascii")
    source = f"data:image/jpeg;base64,{data}"
    return (
        f'<img src="{source}" width="{PICTURE_WIDTH_PX}" height="{height}" '
        f'alt="{escape(description)}">'
    )


def table(header: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """A table of plain texts; the columns in `numeric` are set flush right."""

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = [' class="number"' if column in numeric else "" for column in range(len(cells))]
        return (
            "<tr>"
            + "".join(f"<{tag}{k}>{escape(c)}</{tag}>" for k, c in zip(kinds, cells, strict=True))
            + "</tr>"
        )

    body = "\n".join(line("td", row) for row in rows)
    head = f"<thead>{line('th', header)}</thead>"
    return f'<div class="table"><table>\n{head}\n<tbody>\n{body}\n</tbody>\n</table></div>'


def group_table(title: str, rows: Sequence[tuple[str, str, str, str, str]]) -> str:
    """A table of one group of quantities: what, value, unit, and the bar with its verdict."""
    held = any(bar for *_, bar, _ in rows)
    body = "\n".join(
        f'<tr><td>{escape(label)}</td><td class="number">{escape(value)}</td>'
        f"<td>{escape(unit)}</td>"
        + (f'<td class="bar">{escape(bar)} {_verdict(verdict)}</td>' if held else "")
        + "</tr>"
        for label, value, unit, bar, verdict in rows
    )
    head = (
        f'<thead><tr><th>{escape(title)}</th><th class="number">value</th><th>unit</th>'
        + ("<th>bar</th>" if held else "")
        + "</tr></thead>"
    )
    return f'<div class="table"><table>\n{head}\n<tbody>\n{body}\n</tbody>\n</table></div>'


def _verdict(text: str) -> str:
    """A word with its mark, which colour only underlines."""
    kind = "holds" if text == HOLDS else "missed"
    return f'<span class="{kind}">{escape(text)}</span>' if text else ""


def details(title: str, content: str) -> str:
    """Markup that stays folded until it is asked for."""
    return f"<details>\n<summary>{escape(title)}</summary>\n{content}\n</details>"
