"""The viewer of a packing as a widget of Jupyter. Needs anywidget: ``pip install "packstone[jupyter]"``."""

from __future__ import annotations

import base64
import json
from typing import Any

import anywidget
import traitlets

from .view import SANDBOX


class Viewer(anywidget.AnyWidget):
    """The page of a packing with its viewer in a frame. A change of a trait shows at once."""

    _esm = f"""
function render({{ model, el }}) {{
  const frame = document.createElement("iframe");
  frame.title = "Packing";
  frame.setAttribute("sandbox", {json.dumps(SANDBOX)});
  frame.style.border = "0";
  frame.style.width = "100%";
  const resize = () => {{ frame.style.height = `${{model.get("height_px")}}px`; }};
  const show = () => {{ frame.srcdoc = model.get("page"); }};
  model.on("change:height_px", resize);
  model.on("change:page", show);
  resize();
  show();
  el.append(frame);
  return () => {{
    model.off("change:height_px", resize);
    model.off("change:page", show);
  }};
}}
export default {{ render }};
"""
    _png: bytes | None = None

    @classmethod
    def of(cls, page: str, height_px: int, png: bytes | None) -> Viewer:
        """The viewer of a page, with a picture for saved notebooks, which do not run it."""
        viewer = cls(page=page, height_px=height_px)
        viewer._png = png
        return viewer

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        shown = super()._repr_mimebundle_(**kwargs)
        data, metadata = shown if isinstance(shown, tuple) else (shown, {})
        if data is None or self._png is None:
            return shown
        picture = base64.b64encode(self._png).decode("ascii")
        return {**data, "image/png": picture}, metadata

    page = traitlets.Unicode().tag(sync=True)
    """The page as HTML, a document of its own."""
    height_px = traitlets.Int(640).tag(sync=True)
    """The height of the frame."""
