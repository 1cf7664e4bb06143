"""A worker whose memory is faulty: a proxy between worker and service changes results, with the right digest."""

import hashlib
import re
import socket
import struct
import threading

from .rig import free_port

FIXED = struct.Struct("<8sQQ")
# Share of results that are changed.
SHARE = 0.8


def worker_lies(rig, random):
    """The worker delivers wrong results for some seconds: none is served, and its jobs are packed again."""
    proxy = Proxy(rig, random)
    rig.worker.kill()
    rig.worker.wait()
    rig.start_worker(proxy.port)
    rig.stopping.wait(random.uniform(3, 6))
    rig.worker.kill()
    rig.worker.wait()
    proxy.close()
    rig.ledger.count("wrong results that a worker delivered", proxy.changed)
    # Under another name: the server gives a worker with three wrong results no more jobs.
    rig.start_worker()


def changed(body, random):
    """The same result with a wrong number in it, or without its last bytes; what was done."""
    magic, head, rows = FIXED.unpack_from(body)
    begin = FIXED.size + head
    columns = (len(body) - begin) // (8 * rows) if rows else 0
    if columns < 4:
        return body[:-1], "cut"
    numbers = list(struct.unpack_from(f"<{columns * rows}d", body, begin))
    way = random.choice(["nan", "infinite", "outside", "onto another", "size", "exchanged", "fewer", "cut"])
    row, other = random.randrange(rows), random.randrange(rows)
    if way == "nan":
        numbers[random.randrange(len(numbers))] = float("nan")
    elif way == "infinite":
        numbers[random.randrange(len(numbers))] = float("inf")
    elif way == "outside":
        numbers[random.randrange(3) * rows + row] += 1e4
    elif way == "onto another":
        for column in range(3):
            numbers[column * rows + row] = numbers[column * rows + (row + 1) % rows] + 1e-3
    elif way == "size":
        numbers[3 * rows + row] *= 1.001
    elif way == "exchanged" and numbers[3 * rows + row] != numbers[3 * rows + other]:
        first, second = 3 * rows + row, 3 * rows + other
        numbers[first], numbers[second] = numbers[second], numbers[first]
    elif way == "fewer":
        kept = [numbers[column * rows : (column + 1) * rows - 1] for column in range(columns)]
        text = struct.pack(f"<{columns * (rows - 1)}d", *[number for column in kept for number in column])
        return FIXED.pack(magic, head, rows - 1) + body[FIXED.size : begin] + text, way
    else:
        return body[:-1], "cut"
    return body[:begin] + struct.pack(f"<{len(numbers)}d", *numbers), way


class Proxy:
    """Forwards one request a connection, and changes results."""

    def __init__(self, rig, random):
        self.rig, self.random, self.changed = rig, random, 0
        self.port = free_port()
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.bind(("127.0.0.1", self.port))
        self.listener.listen(50)
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self):
        """Accepts no more connections."""
        self.listener.close()

    def _accept(self):
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self._forward, args=(connection,), daemon=True).start()

    def _forward(self, worker):
        try:
            with worker, socket.create_connection(("127.0.0.1", self.rig.port), timeout=60) as server:
                worker.settimeout(60)
                head, body = _request(worker)
                if head is None:
                    return
                if re.match(rb"PUT \S+/result\?sha256=", head):
                    head, body = self._changed(head, body)
                head = re.sub(rb"\r\n(connection|content-length|transfer-encoding):[^\r]*", b"", head, flags=re.I)
                server.sendall(head + b"\r\nConnection: close\r\nContent-Length: %d\r\n\r\n" % len(body) + body)
                while block := server.recv(65536):
                    worker.sendall(block)
        except (OSError, ValueError):
            pass

    def _changed(self, head, body):
        if self.random.random() > SHARE:
            return head, body
        body, way = changed(body, self.random)
        self.changed += 1
        self.rig.ledger.event(self.rig.name, f"result of a worker: {way}")
        digest = hashlib.sha256(body).hexdigest().encode()
        return re.sub(rb"sha256=[0-9a-f]{64}", b"sha256=" + digest, head, count=1), body


def _request(connection):
    """The head of a request, without the end of its last line, and its body."""
    data = b""
    while b"\r\n\r\n" not in data:
        block = connection.recv(65536)
        if not block:
            return None, b""
        data += block
    head, _, body = data.partition(b"\r\n\r\n")
    length = re.search(rb"\r\ncontent-length: *(\d+)", head, re.I)
    if length:
        while len(body) < int(length.group(1)):
            body += connection.recv(65536) or _end()
    elif re.search(rb"\r\ntransfer-encoding: *chunked", head, re.I):
        raw, body = body, b""
        while True:
            while b"\r\n" not in raw:
                raw += connection.recv(65536) or _end()
            size, _, raw = raw.partition(b"\r\n")
            number = int(size.split(b";")[0], 16)
            while len(raw) < number + 2:
                raw += connection.recv(65536) or _end()
            body += raw[:number]
            raw = raw[number + 2 :]
            if number == 0:
                break
    return head, body


def _end():
    """The sender is gone in the middle of a body."""
    raise ValueError("the body ended early")
