"""The viewer of a packing in notebooks."""

from __future__ import annotations

import html
import importlib.util
from pathlib import Path
from typing import Any

import mixes
import packstone
import pytest
from packstone.jupyter import Viewer


@pytest.fixture(scope="module")
def packing() -> packstone.Packing:
    return packstone.pack(mixes.quick())


@pytest.fixture
def no_anywidget(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def without(name: str, package: str | None = None) -> Any:
        return None if name == "anywidget" else found(name, package)

    monkeypatch.setattr("packstone.packings.find_spec", without)


@pytest.mark.usefixtures("no_anywidget")
def test_a_view_is_a_frame_with_the_page(packing: packstone.Packing, tmp_path: Path) -> None:
    view = packing.view(height_px=321)
    assert isinstance(view, packstone.View) and view.page == packing.read("html").decode()
    frame = view._repr_html_()
    assert frame.startswith("<iframe ") and frame.endswith("></iframe>") and "height: 321px" in frame
    page = html.unescape(frame.split(' srcdoc="')[1].split('"')[0])
    assert page == view.page and page.lower().startswith("<!doctype html>")
    assert view.save(tmp_path / "new" / "a.html").read_text() == page


def test_a_view_is_a_widget_where_anywidget_is(packing: packstone.Packing) -> None:
    viewer = packing.view(height_px=321)
    assert isinstance(viewer, Viewer)
    assert viewer.page == packing.read("html").decode() and viewer.height_px == 321
    state = viewer.get_state()
    assert state["page"] == viewer.page and "srcdoc" in state["_esm"]


def test_the_page_of_a_service_is_that_of_this_process(packing: packstone.Packing, client: packstone.Client) -> None:
    there = client.submit(mixes.quick()).result()
    pages = [source.read("html").decode() for source in (packing, there)]
    # They differ in the name of the job and the times.
    scripts = [page.split("<script", 2)[:2] for page in pages]
    assert scripts[0] == scripts[1] and abs(len(pages[0]) - len(pages[1])) < 1000


def test_notebooks_show_a_cross_section(packing: packstone.Packing) -> None:
    shown = packing._repr_html_()
    assert "data:image/png;base64," in shown and "volume_fraction_effective" in shown
    assert repr(packing).startswith(f"<Packing of {len(packing)} grains: box of 40 x 40 x 40 mm, volume fraction 0.19")
    named = packstone.pack(mixes.quick(), name="<b>")
    assert "&lt;b&gt;" in named._repr_html_()
