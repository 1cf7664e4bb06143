"""The viewer of a packing in notebooks."""

from __future__ import annotations

import html
import importlib.util
import struct
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


def test_a_picture_has_one_octant_removed(
    packing: packstone.Packing, client: packstone.Client, tmp_path: Path
) -> None:
    picture = packing.picture(tmp_path / "new" / "a.png", pixels=100)
    assert isinstance(picture, packstone.Picture) and max(size(picture)) == 100
    assert (tmp_path / "new" / "a.png").read_bytes() == picture._repr_png_() == picture
    # That of a service is drawn here, of the same grains.
    assert client.submit(mixes.quick()).result().picture(pixels=100) == picture
    with pytest.raises(FileExistsError, match="a.png exists"):
        packing.picture(tmp_path / "new" / "a.png")
    with pytest.raises(ValueError, match="pixels: 9000 is out of range: must be at least 64 and at most 8192"):
        packing.picture(pixels=9000)
    packing.save(tmp_path / "a.csv")
    table = packstone.load(tmp_path / "a.csv")
    with pytest.raises(ValueError, match="a.csv is a table of grains, without the specimen that a picture needs"):
        table.picture()
    assert table._repr_png_() is None and "<img" not in table._repr_html_()


def test_notebooks_show_a_picture(packing: packstone.Packing, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = packing._repr_html_()
    assert "data:image/png;base64," in shown and "volume_fraction_effective" in shown
    picture = packing._repr_png_()
    assert picture == packing.picture(pixels=480)
    # Of many grains it is a cross-section.
    monkeypatch.setattr("packstone.packings.MOST_GRAINS_OF_PICTURES", len(packing) - 1)
    assert packing._repr_png_() == packing.read("png", pixels=480) != picture
    assert repr(packing).startswith(f"<Packing of {len(packing)} grains: box of 40 x 40 x 40 mm, volume fraction 0.19")
    named = packstone.pack(mixes.quick(), name="<b>")
    assert "&lt;b&gt;" in named._repr_html_()


def size(png: bytes) -> tuple[int, int]:
    """Width and height of a PNG."""
    assert png.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", png[16:24])
    return width, height
