"""Writes the HTML that notebooks show for jobs, studies and results."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape


def card(title: str, rows: Mapping[str, object], *, bar: float | None = None, png: bytes | None = None) -> str:
    """Returns a table with a title, and a bar and a picture if they are given. All text is escaped."""
    lines = [f"<strong>{escape(title)}</strong>"]
    if bar is not None:
        lines.append(f'<br><progress value="{bar:.4f}" max="1" style="width: 20em"></progress> {bar:.0%}')
    cells = "".join(
        f'<tr><th style="text-align: left">{escape(name)}</th>'
        f'<td style="text-align: left">{escape(_text(value))}</td></tr>'
        for name, value in rows.items()
        if value not in (None, "", {}, [])
    )
    lines.append(f"<table>{cells}</table>")
    if png is not None:
        data = base64.b64encode(png).decode("ascii")
        lines.append(f'<img alt="packing" src="data:image/png;base64,{data}" style="max-width: 24em">')
    return f'<div class="packstone">{"".join(lines)}</div>'


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_text(item)}" for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return "; ".join(map(_text, value))
    return str(value)
