"""Webhooks of jobs and studies, received by a server of the standard library."""

from __future__ import annotations

import base64
import hmac
import json
import queue
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
from live_server import LiveServer, binary
from mixes import endless, quick

import packstone


@pytest.fixture
def received() -> Iterator[tuple[str, queue.Queue[tuple[Any, bytes]]]]:
    messages: queue.Queue[tuple[Any, bytes]] = queue.Queue()

    class Receiver(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            messages.put((self.headers, self.rfile.read(int(self.headers["content-length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Receiver) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/in", messages
        server.shutdown()


def test_a_job_and_a_study_end_in_signed_messages(
    tmp_path: Path, received: tuple[str, queue.Queue[tuple[Any, bytes]]]
) -> None:
    url, messages = received
    secret = subprocess.run([binary(), "webhook-secret"], capture_output=True, text=True, check=True).stdout.strip()
    file = tmp_path / "secret"
    file.write_text(secret + "\n")
    options = ("--webhook-secret-file", str(file), "--webhook-allowed-host", "127.0.0.1")
    with LiveServer(tmp_path, *options) as server, packstone.Client(server.url) as client:
        assert client.capabilities()["webhooks"] is True
        job = client.submit(quick(1), webhook_url=url)
        assert job.data["webhook"]["url"] == url
        ended = messages.get(timeout=60)
        assert "webhook" not in job.update(webhook_url=None).data
        # One that does not end before the server knows the URL.
        study = client.study(list=[endless()])
        assert study.update(webhook_url=url).data["webhook"]["url"] == url
        study.cancel()
        expected = ((ended, "job.succeeded", job.id), (messages.get(timeout=60), "study.finished", study.id))
    for (headers, body), kind, id in expected:
        text = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        digest = hmac.digest(base64.b64decode(secret.removeprefix("whsec_")), text, "sha256")
        assert headers["webhook-signature"] == "v1," + base64.b64encode(digest).decode()
        message = json.loads(body)
        assert (message["type"], message["data"]["id"]) == (kind, id)
