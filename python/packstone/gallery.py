"""The gallery: requests to start from, which the package carries."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from .errors import invalid, near


def examples() -> dict[str, str]:
    """Returns the names of the requests of the gallery, each with its title.

    :func:`example` returns one of them. `docs/gallery.md` shows a picture of each.

    Examples
    --------
    >>> len(packstone.examples()) > 30
    True
    >>> packstone.examples()["fuller-curve"]
    "Fuller's curve, densely"
    """
    return {name: entry["title"] for name, entry in _gallery().items()}


def example(name: str) -> dict[str, Any]:
    """Returns a request of the gallery, which :func:`pack`, :func:`plan` and :meth:`Client.submit` take.

    It is the request that ``packstone run --example NAME`` packs. Change it as any dictionary. :func:`pack` makes no
    exports: those that a request has under ``postprocess`` are made by a service and by the command.

    Parameters
    ----------
    name
        One of :func:`examples`.

    Raises
    ------
    ValueError
        If the gallery has no such example.

    Examples
    --------
    >>> request = packstone.example("random-addition")
    >>> request["specimen"] = packstone.Box(30)
    >>> packstone.pack(request).specimen["size_mm"]
    [30.0, 30.0, 30.0]
    """
    gallery = _gallery()
    if name not in gallery:
        raise invalid("name", f"{name!r} must be one of packstone.examples(){near(name, gallery)}")
    request: dict[str, Any] = json.loads(json.dumps(gallery[name]["request"]))
    return request


@cache
def _gallery() -> dict[str, dict[str, Any]]:
    gallery: dict[str, dict[str, Any]] = json.loads((files("packstone") / "gallery.json").read_text(encoding="utf-8"))
    return gallery
