"""The viewer of a packing as a widget of Jupyter. Needs anywidget: ``pip install "packstone[jupyter]"``."""

from __future__ import annotations

import json

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
    page = traitlets.Unicode().tag(sync=True)
    """The page as HTML, a document of its own."""
    height_px = traitlets.Int(640).tag(sync=True)
    """The height of the frame."""
