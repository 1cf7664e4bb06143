"""A proxy in front of the server that does to requests what networks do to them."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from email.message import Message
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread


@dataclass(frozen=True)
class Refused:
    """Not passed on: the connection breaks before an answer."""


@dataclass(frozen=True)
class AnswerLost:
    """Passed on, but the connection breaks before the answer arrives."""


@dataclass(frozen=True)
class CutAfter:
    """Passed on, but the connection breaks after so many bytes of the answer's body."""

    body_bytes: int


@dataclass(frozen=True)
class Answered:
    """Not passed on, but answered by the proxy itself."""

    status: int
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""


Fault = Refused | AnswerLost | CutAfter | Answered


@dataclass(frozen=True)
class Seen:
    """A request that arrived."""

    method: str
    path: str
    headers: Message


class FaultyProxy:
    """Meets one request after another with the next of `faults`, and passes on what comes after them."""

    def __init__(self, upstream: str) -> None:
        self.faults: deque[Fault] = deque()
        self.dropped_fields: set[str] = set()
        self.seen: list[Seen] = []
        proxy = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, format: str, *args: object) -> None:
                pass

            def handle_one_request(self) -> None:
                try:
                    super().handle_one_request()
                except OSError:
                    # The client left in the middle.
                    self.close_connection = True

            def answer(self) -> None:
                length = int(self.headers.get("content-length", 0))
                body = self.rfile.read(length)
                proxy.seen.append(Seen(self.command, self.path, self.headers))
                fault = proxy.faults.popleft() if proxy.faults else None
                if isinstance(fault, Refused):
                    return self.break_off()
                if isinstance(fault, Answered):
                    return self.send(fault.status, fault.headers, fault.body)
                status, headers, content = self.passed_on(body)
                if isinstance(fault, AnswerLost):
                    return self.break_off()
                if isinstance(fault, CutAfter):
                    self.send(status, headers, content, fault.body_bytes)
                    return self.break_off()
                self.send(status, headers, content)

            do_GET = do_POST = do_PATCH = do_DELETE = answer

            def passed_on(self, body: bytes) -> tuple[int, Mapping[str, str], bytes]:
                connection = HTTPConnection(upstream, timeout=90)
                fields = {k: v for k, v in self.headers.items() if k.lower() not in proxy.dropped_fields}
                connection.request(self.command, self.path, body, fields)
                response = connection.getresponse()
                content = response.read()
                connection.close()
                return response.status, dict(response.getheaders()), content

            def send(
                self, status: int, headers: Mapping[str, str], content: bytes, only: int | None = None
            ) -> None:
                self.send_response_only(status)
                own = ("content-length", "transfer-encoding", "connection")
                for name, value in headers.items():
                    if name.lower() not in own:
                        self.send_header(name, value)
                if status not in (204, 304):
                    self.send_header("content-length", str(len(content)))
                self.end_headers()
                self.wfile.write(content[:only])

            def break_off(self) -> None:
                self.close_connection = True
                self.wfile.flush()
                self.connection.shutdown(socket.SHUT_RDWR)

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        # A client that is still open would hold its thread.
        self._server.daemon_threads = True
        self._server.block_on_close = False
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends it."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
