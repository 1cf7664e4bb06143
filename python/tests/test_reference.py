"""The reference of the documentation, against the package."""

from __future__ import annotations

import re

from live_server import REPOSITORY

import packstone


def test_the_reference_has_every_public_name() -> None:
    page = (REPOSITORY / "docs/python.md").read_text()
    assert set(re.findall(r"^::: packstone\.(\w+)$", page, re.MULTILINE)) == set(packstone.__all__)
