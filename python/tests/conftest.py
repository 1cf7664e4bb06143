"""Fixtures: the server under test, clients and a faulty proxy."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from faulty_proxy import FaultyProxy
from live_server import LiveServer

import packstone


def pytest_configure() -> None:
    """Removes the environment variables that change the client under test, and lets interrupts be handled."""
    # A shell starts what it runs in the background with interrupts ignored; Python then handles none.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for name in ("PACKSTONE_URL", "PACKSTONE_API_KEY"):
        os.environ.pop(name, None)
    os.environ["NO_PROXY"] = "127.0.0.1"


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A server with two workers. All tests share it, so that no test may rely on being alone."""
    with LiveServer(tmp_path_factory.mktemp("server"), "--workers", "2") as live:
        yield live


@pytest.fixture(scope="session")
def session_client(server: LiveServer) -> Iterator[packstone.Client]:
    """A client for the jobs and studies that several tests share."""
    with packstone.Client(server.url) as client:
        yield client


@pytest.fixture
def client(server: LiveServer) -> Iterator[packstone.Client]:
    """A client of the server."""
    with packstone.Client(server.url) as client:
        yield client


@pytest.fixture
def proxy(server: LiveServer) -> Iterator[FaultyProxy]:
    """A proxy to the server that breaks the requests that a test names."""
    proxy = FaultyProxy(server.address)
    yield proxy
    proxy.stop()


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses between attempts. They are recorded and not made."""
    noted: list[float] = []
    monkeypatch.setattr("packstone._transport.sleep", noted.append)
    return noted
