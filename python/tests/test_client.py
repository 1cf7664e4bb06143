"""Where the server is and who may talk to it; the package itself."""

from __future__ import annotations

import hashlib
import importlib.metadata
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import mixes
import packstone
import pytest
from faulty_proxy import FaultyProxy
from live_server import REPOSITORY, LiveServer

KEY = "packstone_" + 64 * "0"


@pytest.fixture
def locked_server(tmp_path: Path) -> Iterator[LiveServer]:
    """A server that asks for a key."""
    keys = tmp_path / "keys.txt"
    keys.write_text(f"{hashlib.sha256(KEY.encode()).hexdigest()} lab role=admin\n")
    with LiveServer(tmp_path, "--api-keys-file", str(keys)) as live:
        yield live


def test_a_key_opens_the_server(locked_server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in (None, "packstone_wrong"):
        with packstone.Client(locked_server.url, wrong) as client:
            with pytest.raises(packstone.PackstoneError) as refused:
                client.capabilities()
            assert refused.value.kind == "unauthorized"
    with packstone.Client(locked_server.url, KEY + "\n") as client:
        assert client.capabilities()["limits"]["workers"] >= 1
        assert {"name": "lab", "owner": "lab", "role": "admin"}.items() <= client.key().items()
        assert KEY not in repr(client)
    monkeypatch.setenv("PACKSTONE_URL", locked_server.url)
    monkeypatch.setenv("PACKSTONE_API_KEY", KEY)
    with packstone.Client() as client:
        assert client.submit(mixes.quick()).result().grains.shape[1] == 4


def test_an_id_is_one_segment_of_the_path(proxy: FaultyProxy) -> None:
    with packstone.Client(proxy.url) as client, pytest.raises(packstone.PackstoneError) as refused:
        client.job("../capabilities?")
    assert refused.value.kind == "not-found"
    assert proxy.seen[0].path == "/v1/jobs/..%2Fcapabilities%3F"


def test_without_an_address_the_server_is_that_of_this_machine() -> None:
    with packstone.Client() as client:
        assert repr(client) == "<Client of http://127.0.0.1:8080>"


def test_a_client_that_is_closed_sends_nothing(server: LiveServer) -> None:
    with packstone.Client(server.url) as client:
        copy = pickle.loads(pickle.dumps(client))
        assert client.capabilities()["version"]
    with pytest.raises(RuntimeError, match=f"the client of {server.url} is closed"):
        client.capabilities()
    with copy:
        assert copy.capabilities()["version"]


def test_notebooks_show_the_address_and_not_the_key() -> None:
    html = packstone.Client("http://lab:1?<b>", KEY)._repr_html_()
    assert "http://lab:1?&lt;b&gt;" in html and KEY not in html


@pytest.mark.parametrize("url", ["localhost:8080", "ftp://lab", "http://"])
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="must be like http://localhost:8080"):
        packstone.Client(url)


def test_a_server_below_a_path_is_found(proxy: FaultyProxy) -> None:
    with packstone.Client(f"{proxy.url}/lab/") as client, pytest.raises(packstone.PackstoneError):
        client.capabilities()
    assert proxy.seen[0].path == "/lab/v1/capabilities"
    version = importlib.metadata.version("packstone")
    assert proxy.seen[0].headers["user-agent"] == f"packstone-python/{version}"
    assert packstone.__version__ == version


def test_the_package_is_installed_with_its_types() -> None:
    assert packstone.__file__ is not None
    package = Path(packstone.__file__).parent
    assert not package.is_relative_to(REPOSITORY / "python"), "the tests must run against an installation"
    assert (package / "py.typed").exists()
    assert set(packstone.__all__) <= set(dir(packstone))


def test_an_import_leaves_other_libraries_out(tmp_path: Path) -> None:
    others = {"httpx", "numpy", "pandas", "anywidget"}
    script = f"import packstone, sys; print(sorted({others!r} & sys.modules.keys()))"
    said = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert said == "[]\n"


def test_a_server_below_a_path_is_a_server(tmp_path: Path) -> None:
    with LiveServer(tmp_path, "--base-path", "/lab/packstone", "--workers", "1") as live:
        for url in (f"{live.url}/lab/packstone", f"{live.url}/lab/packstone/"):
            with packstone.Client(url) as client:
                job = client.submit(mixes.quick())
                # Links of the server name the path that every request begins with.
                assert job.path.startswith("/lab/packstone/v1/jobs/")
                assert job.wait().succeeded
                assert job.refresh().succeeded
                assert job.request["mix"]["grading"] == mixes.quick()["mix"]["grading"]
                assert len(job.result(timeout=60).grains) > 0
                assert next(iter(client.jobs())).id == job.id
