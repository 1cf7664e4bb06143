"""Requests of honest clients, and bytes of those that are not."""

import http.client
import json
import socket
import time

# An answer may take this long on a machine that is busy with everything else here; longer is a fault.
MOST_S = 40.0
# What a client that behaves meets while the machine is at fault or the service busy: it tries again later.
LATER = {429, 503, 507, 408}


class Answer:
    """The answer to a request. It is whole where all announced bytes came."""

    def __init__(self, status, headers, body, whole):
        self.status, self.headers, self.body, self.whole = status, headers, body, whole

    def json(self):
        """The body as JSON; `None` where it is none."""
        try:
            return json.loads(self.body)
        except ValueError:
            return None

    def __str__(self):
        return f"{self.status} {self.headers} {self.body[:1500]!r}{'' if self.whole else ' (cut)'}"


class Client:
    """Sends one request a connection, from one address, with or without a key."""

    def __init__(self, rig, key=None, source="127.0.0.1", honest=True):
        self.rig, self.key, self.source, self.honest = rig, key, source, honest

    def ask(self, method, path, body=None, headers=None, timeout=MOST_S):
        """The answer; `None` where none came, because the connection was refused or cut."""
        fields = dict(headers or {})
        if self.key:
            fields.setdefault("Authorization", f"Bearer {self.key}")
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
            fields.setdefault("Content-Type", "application/json")
        address = ("127.0.0.1", self.rig.port)
        connection = http.client.HTTPConnection(*address, timeout=timeout, source_address=(self.source, 0))
        began = time.monotonic()
        try:
            connection.request(method, path, body, fields)
            response = connection.getresponse()
            status, names = response.status, {name.lower(): value for name, value in response.getheaders()}
            try:
                data, whole = response.read(), True
            except http.client.IncompleteRead as cut:
                data, whole = cut.partial, False
            except OSError:
                data, whole = b"", False
        except TimeoutError:
            self._silent(method, path, body, time.monotonic() - began)
            return None
        except (OSError, http.client.HTTPException):
            return None
        finally:
            connection.close()
        answer = Answer(status, names, data, whole)
        self.rig.judge_status(self.honest, status, f"{method} {path} {fields} {(body or b'')[:1500]!r}", answer)
        return answer

    def _silent(self, method, path, body, waited):
        """An honest request without an answer, though nothing stopped the service, is a fault."""
        if self.honest and not self.rig.windows.allows(time.monotonic() - waited, time.monotonic(), 10):
            self.rig.broke_other(f"no answer within {waited:.0f} s", f"{method} {path} {(body or b'')[:500]!r}")


def connect(rig, source, timeout=10.0, receive=None):
    """A connection of a hostile client, with a small buffer for what it receives on demand; `None` if refused."""
    found = socket.socket()
    try:
        found.settimeout(timeout)
        if receive:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive)
        found.bind((source, 0))
        found.connect(("127.0.0.1", rig.port))
        return found
    except OSError:
        found.close()
        return None


def send(connection, data):
    """Whether the bytes were sent."""
    try:
        connection.sendall(data)
        return True
    except OSError:
        return False


def first_answer(connection, limit=65536):
    """The bytes that come until the end of a head, or of the connection."""
    data = b""
    try:
        while b"\r\n\r\n" not in data and len(data) < limit:
            block = connection.recv(4096)
            if not block:
                break
            data += block
    except OSError:
        pass
    return data


def status_of(data):
    """The status of an answer in bytes; 0 where it is none."""
    words = data.split(b" ", 2)
    return int(words[1]) if len(words) > 1 and data.startswith(b"HTTP/1.") and words[1].isdigit() else 0
