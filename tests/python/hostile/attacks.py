"""Clients that do not behave. None of them may cost an honest client more than a moment, or get an answer of 500."""

import json
import socket
import struct
import threading
import time

from . import bodies
from .ledger import DOUBLED, RIGHTS
from .places import is_served
from .wire import connect, first_answer, send, status_of

# A service that reads no more of what is sent holds an attacker up for so long at most.
MOST_OPENING_S = 6.0
JSON = b"Content-Type: application/json\r\n"


def run(rig, random, until, only):
    """Attacks one after the other, each once in an order that is drawn, and again."""
    names = [name for name in ATTACKS if not only or name in only]
    while names and not rig.stopping.is_set():
        random.shuffle(names)
        for name in names:
            if time.monotonic() > until - 3:
                return
            rig.ledger.event(rig.name, name)
            source = f"127.{random.randrange(1, 250)}.{random.randrange(1, 250)}.{random.randrange(2, 250)}"
            ATTACKS[name](rig, random, source)
            rig.stopping.wait(random.uniform(0.2, 1.5))


def hold(rig, connections, seconds, each=b"", beside=""):
    """Keeps connections open for a time, with these bytes a second on each, and judges what they are answered."""
    end = time.monotonic() + seconds
    is_served(rig, beside)
    while time.monotonic() < end and not rig.stopping.wait(0.5):
        if each:
            connections = [connection for connection in connections if send(connection, each) or drop(rig, connection)]
    for connection in connections:
        drop(rig, connection)


def drop(rig, connection):
    """Reads what was answered, if anything, and closes."""
    try:
        connection.settimeout(0.05)
        judge(rig, b"", first_answer(connection))
    finally:
        connection.close()


def judge(rig, request, answer, seen=None):
    """Counts an answer in bytes; returns its status."""
    status = status_of(answer)
    if status:
        rig.judge_status(False, status, request[:1500], answer.decode(errors="replace"))
    if seen is not None:
        seen.append(status)
    return status


def many(rig, source, number, data, receive=None):
    """Opens so many connections and sends these bytes, or those of each number, on each, as far as they are read."""
    found, end = [], time.monotonic() + MOST_OPENING_S
    for index in range(number):
        if time.monotonic() > end or rig.stopping.is_set():
            break
        connection = connect(rig, source, receive=receive)
        if connection is None:
            continue
        connection.settimeout(1.0)
        text = data(index) if callable(data) else data
        if text and not send(connection, text):
            drop(rig, connection)
            continue
        found.append(connection)
    return found


def head(method, target, *fields, host=b"localhost"):
    """The head of a request without its end."""
    return b"%s %s HTTP/1.1\r\nHost: %s\r\n%s" % (method, target, host, b"".join(fields))


def slow_bodies(rig, random, source):
    """Bodies of a stated length that come byte by byte, and never whole."""
    target = random.choice([b"/v1/jobs", b"/v1/plans", b"/v1/studies", b"/session", b"/v1/leases"])
    length = random.choice([100, 4000, 1 << 20, 16 << 20, 16 << 20])
    begin = head(b"POST", target, JSON, b"Sec-Fetch-Site: same-origin\r\n", b"Content-Length: %d\r\n\r\n" % length)
    part = b" " * min(length - 1, random.choice([1, 200_000, length, length]))
    hold(rig, many(rig, source, 60, begin + part), random.uniform(1, 4), b" ", "slow bodies")


def slow_heads(rig, random, source):
    """Heads that never end."""
    begin = head(random.choice([b"GET", b"POST"]), b"/v1/jobs", b"X-Filler: ")
    hold(rig, many(rig, source, 60, begin), random.uniform(1, 4), b"x" * random.choice([1, 300]), "slow heads")


def chunked_bodies(rig, random, source):
    """Chunked bodies of no stated length that never end."""
    target = random.choice([b"/v1/jobs", b"/v1/plans", b"/v1/studies", b"/session"])
    begin = head(b"POST", target, JSON, b"Sec-Fetch-Site: same-origin\r\n", b"Transfer-Encoding: chunked\r\n\r\n")
    size = random.choice([1, 16_000])
    chunk = b"%x\r\n%s\r\n" % (size, b" " * size)
    hold(rig, many(rig, source, 60, begin + chunk), random.uniform(1, 4), chunk, "chunked bodies")


def silent_connections(rig, random, source):
    """As many connections as one address may have, on which nothing is said."""
    hold(rig, many(rig, source, 512, b""), random.uniform(1, 3), beside="silent connections")


def stalled_readers(rig, random, source):
    """Clients that ask for results, exports and events and do not read them."""
    jobs = [job for job in list(rig.jobs.values()) if job.done and not job.deleted]
    targets = [b"/v1/events", b"/v1/jobs", b"/openapi.json"]
    for job in random.sample(jobs, min(8, len(jobs))):
        name = job.id.encode()
        targets += [b"/v1/jobs/%s/result?format=%s" % (name, form) for form in (b"html", b"json", b"npy")]
        targets += [b"/v1/jobs/%s/events" % name, b"/v1/jobs/%s/exports/voxels?format=raw&cells=100" % name]
    key = b"Authorization: Bearer %s\r\n" % rig.keys["carl"][0].encode() if rig.with_keys else b""
    requests = [head(b"GET", random.choice(targets), key) + b"\r\n" for _ in range(100)]
    readers = many(rig, source, 100, lambda index: requests[index], receive=2048)
    hold(rig, readers, random.uniform(2, 5), beside="stalled readers")


def waiting_clients(rig, random, source):
    """Long polls, event streams, and connections that stay idle after a request."""
    jobs = [job for job in list(rig.jobs.values()) if job.id and not job.deleted]
    targets = [b"/v1/events", b"/v1/capabilities"]
    for job in random.sample(jobs, min(5, len(jobs))):
        targets += [b"/v1/jobs/%s" % job.id.encode(), b"/v1/jobs/%s/events" % job.id.encode()]
    fields = [b"Prefer: wait=60\r\n"]
    if rig.with_keys:
        fields.append(b"Authorization: Bearer %s\r\n" % rig.keys["root"][0].encode())
    requests = [head(b"GET", random.choice(targets), *fields) + b"\r\n" for _ in range(300)]
    waiting = many(rig, source, 300, lambda index: requests[index])
    hold(rig, waiting, random.uniform(1, 3), beside="clients that wait")


def same_order_at_once(rig, random, source):
    """One order that is sent by many clients at the same moment makes one job."""
    key = f"race-{rig.name}-{random.randrange(1 << 40)}"
    job = bodies.body("quick", 1, key)
    client, made = rig.client("bert", source), []

    def order():
        answer = client.ask("POST", "/v1/jobs", job, {"Idempotency-Key": key})
        if answer and answer.status in (200, 201):
            made.append(answer.json()["id"])

    with rig.submitting_one():
        threads = [threading.Thread(target=order, daemon=True) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if len(set(made)) > 1:
        rig.ledger.broke(DOUBLED, rig.name, f"one order made {set(made)}", f"Idempotency-Key {key}")
    for identity in set(made):
        rig.remove(client, identity)


def malformed(rig, random, source):
    """Bytes that are no HTTP, or nearly."""
    texts = [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(random.randrange(256) for _ in range(200)),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"GET\r\n\r\n", b"GET /v1/jobs\r\n\r\n", b"\r\n\r\n\r\n",
        b"GET /v1/jobs HTTP/9.9\r\nHost: localhost\r\n\r\n", b"GET /v1/jobs HTTP/1.1\r\n\r\n",
        head(b"GET", b"/v1/jobs", b"Host: localhost\r\n") + b"\r\n",
        head(b"GET", b"/v1/jobs", b"Bad Name: x\r\n") + b"\r\n",
        head(b"GET", b"/v1/jobs", b"X: a\x00b\r\n") + b"\r\n",
        head(b"GET", b"/v1/jobs/%ff%00%c0%ae/../../../etc/passwd") + b"\r\n",
        head(b"GET", b"/" + b"a" * 70_000) + b"\r\n",
        head(b"GET", b"/v1/jobs?" + b"a&" * 20_000) + b"\r\n",
        head(b"GET", b"/v1/jobs", *[b"X-%d: y\r\n" % n for n in range(300)]) + b"\r\n",
        head(b"POST", b"/v1/jobs", JSON, b"Content-Length: -1\r\n") + b"\r\n",
        head(b"POST", b"/v1/jobs", JSON, b"Content-Length: 99999999999999999999\r\n") + b"\r\n{}",
        head(b"POST", b"/v1/jobs", JSON, b"Content-Length: 5\r\nContent-Length: 6\r\n") + b"\r\n{}    ",
        head(b"POST", b"/v1/jobs", JSON, b"Content-Length: 2\r\nTransfer-Encoding: chunked\r\n") + b"\r\n0\r\n\r\n",
        head(b"POST", b"/v1/jobs", JSON, b"Transfer-Encoding: chunked\r\n") + b"\r\nzz\r\n",
        head(b"POST", b"/v1/jobs", JSON, b"Transfer-Encoding: gzip\r\n") + b"\r\n",
        head(b"POST", b"/v1/jobs", JSON, b"Expect: 200-maybe\r\nContent-Length: 2\r\n") + b"\r\n{}",
        head(b"CONNECT", b"evil.example:443") + b"\r\n", head(b"TRACE", b"/v1/jobs") + b"\r\n",
        head(b"OPTIONS", b"*") + b"\r\n", head(b"\xff\xfe", b"/") + b"\r\n",
        head(b"GET", b"/v1/events", b"Last-Event-ID: 99999999999999999999999\r\n") + b"\r\n",
        head(b"GET", b"/v1/jobs", b"Range: bytes=9-1,2-3,-0\r\n", b"If-None-Match: \"\"\"\r\n") + b"\r\n",
    ]
    for text in texts:
        connection = connect(rig, source)
        if connection is None:
            continue
        with connection:
            if send(connection, text):
                connection.settimeout(2.0)
                status = judge(rig, text, first_answer(connection))
                if 200 <= status < 300 and text.startswith(b"CONNECT"):
                    rig.broke_other("CONNECT is answered with success", text)


def hostile_json(rig, random, source):
    """A megabyte of JSON that is deep, wide, or repeats itself."""
    size = 1 << 20
    bodies = [
        b"[" * size, b'{"a":' * (size // 5), b'{"seed":[' + b"0," * (size // 2) + b"0]}",
        b"{" + b",".join(b'"%x":1' % n for n in range(size // 10)) + b"}",
        b'{"name":"' + b"\\u0001" * (size // 6) + b'"}', b'{"list":[' + b"{}," * (size // 3) + b"{}]}",
        b'{"template":{},"grid":{' + b",".join(b'"/%x":[1]' % n for n in range(size // 12)) + b"}}",
        b'{"seed":' + b"9" * size + b"}", b'{"seed":1e' + b"9" * 1000 + b"}", b"\xff" * size, b'"' + b"x" * size,
        b'{"labels":{' + b",".join(b'"%x":"a"' % n for n in range(size // 12)) + b"}}",
    ]
    client = rig.client("bert", source, honest=False)
    for body in random.sample(bodies, 5):
        path = random.choice(["/v1/jobs", "/v1/studies", "/v1/plans"])
        answer = client.ask("POST", path, body, {"Content-Type": "application/json"}, timeout=20)
        if answer and 200 <= answer.status < 300:
            rig.broke_other("a hostile body is accepted", f"POST {path} {body[:200]!r}", answer)


def cross_site(rig, random, source):
    """Forms that a page of another site sends with the browser of a user."""
    jobs = [job for job in list(rig.jobs.values()) if job.id and not job.deleted]
    if not jobs:
        return
    client = rig.client(None, source, honest=False)
    site = {"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site"}
    kinds = ["application/x-www-form-urlencoded", "text/plain", "multipart/form-data"]
    form = {"Content-Type": random.choice(kinds)}
    parts = [site, {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Sec-Fetch-Site": "same-site"}]
    fields = random.choice(parts)
    for job in random.sample(jobs, min(3, len(jobs))):
        for method, path in (
            ("POST", f"/v1/jobs/{job.id}/cancel"), ("POST", f"/v1/jobs/{job.id}/retry"),
            ("POST", f"/v1/jobs/{job.id}/exports/slice"), ("POST", "/v1/jobs"), ("POST", "/v1/studies"),
            ("DELETE", f"/v1/jobs/{job.id}/exports/slice"), ("PATCH", f"/v1/jobs/{job.id}"),
        ):
            if job.state not in ("succeeded",) and path.endswith("cancel"):
                continue
            answer = client.ask(method, path, b"{}", form | fields, timeout=20)
            if answer and (answer.status < 400 or answer.status == 409):
                what = f"another site's {method} is not refused"
                rig.ledger.broke(RIGHTS, rig.name, what, f"{path} {fields}", answer)


def wrong_keys(rig, random, source):
    """Keys, sessions and cookies that nobody gave out, and a key that asks for more than its role allows."""
    if not rig.with_keys:
        return
    good = rig.keys["anna"][0]
    flipped = bytearray(good.encode())
    flipped[random.randrange(12, len(flipped))] ^= 1
    for value in (
        "Bearer packstone_" + "0" * 64, "Bearer " + flipped.decode(errors="replace"), "Bearer " + good[:-1],
        "Bearer", "Basic " + good, "Bearer " + "x" * 8000, "Bearer  ", "Digest a=b",
    ):
        for path in ("/v1/jobs", "/v1/events", "/metrics"):
            answer = rig.client(None, source, False).ask("GET", path, None, {"Authorization": value}, timeout=20)
            if answer and answer.status < 400:
                rig.ledger.broke(RIGHTS, rig.name, "a wrong key opens", f"GET {path} {value}", answer)
    cookie = {"Cookie": "packstone_session=" + "A" * 80}
    for name, method, path, fields in (
        (None, "GET", "/v1/jobs", cookie), ("carl", "POST", "/v1/jobs", {}), ("anna", "GET", "/metrics", {}),
        ("prometheus", "GET", "/v1/jobs", {}), ("cluster", "GET", "/v1/jobs", {}), ("anna", "POST", "/v1/leases", {}),
    ):
        body = None if method == "GET" else {}
        answer = rig.client(name, source, False).ask(method, path, body, fields, timeout=20)
        if answer and answer.status < 400:
            rig.ledger.broke(RIGHTS, rig.name, f"{name}: {method} {path} is allowed", path, answer)


def absolute_targets(rig, random, source):
    """Requests that name another host in their target, or in `Host`, than that of this machine."""
    if rig.with_keys:
        return
    texts = [
        head(b"GET", b"http://evil.example/v1/jobs") + b"\r\n",
        head(b"GET", b"http://evil.example:80/v1/jobs", host=b"evil.example") + b"\r\n",
        head(b"GET", b"/v1/jobs", host=b"evil.example") + b"\r\n",
        head(b"GET", b"/v1/jobs", host=b"localhost.evil.example") + b"\r\n",
        head(b"GET", b"http://user@evil.example/v1/jobs") + b"\r\n",
    ]
    for text in texts:
        connection = connect(rig, source)
        if connection is None:
            continue
        with connection:
            if send(connection, text):
                connection.settimeout(5.0)
                answer = first_answer(connection)
                if 200 <= judge(rig, text, answer) < 300:
                    rig.ledger.broke(RIGHTS, rig.name, "another host is accepted", text, answer)


def plans_at_once(rig, random, source):
    """Plans of polyhedra, which cost the most of all requests, at once."""
    shape = {"type": "polyhedron", "faces": 60, "template_count": 4}
    mix = {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.3, "shape": shape}
    def ask(number):
        edge_mm = 60 + random.randrange(1000) / 100 + number
        plan = {"specimen": {"type": "box", "size_mm": [edge_mm] * 3}, "mix": mix, "distance": {"type": "none"}}
        rig.client("carl", source, honest=False).ask("POST", "/v1/plans", plan, timeout=20)
    threads = [threading.Thread(target=ask, args=(number,), daemon=True) for number in range(16)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads) and not rig.stopping.is_set():
        began = time.monotonic()
        if rig.client(honest=False).ask("GET", "/healthz", timeout=20) and not rig.windows.allows(began, began):
            rig.ledger.peak("longest answer of /healthz beside 16 plans, ms", int(1000 * (time.monotonic() - began)))
        rig.stopping.wait(0.1)


def resets(rig, random, source):
    """Clients that are gone in the middle of an answer."""
    jobs = [job for job in list(rig.jobs.values()) if job.done and not job.deleted]
    key = b"Authorization: Bearer %s\r\n" % rig.keys["root"][0].encode() if rig.with_keys else b""
    for _ in range(30):
        target = b"/v1/jobs/%s/result?format=csv" % random.choice(jobs).id.encode() if jobs else b"/v1/jobs"
        connection = connect(rig, source, receive=2048)
        if connection is None:
            continue
        # A reset in place of an orderly end.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        if send(connection, head(b"GET", target, key) + b"\r\n") and random.random() < 0.7:
            try:
                connection.recv(random.randrange(1, 2000))
            except OSError:
                pass
        connection.close()


def rare_fields(rig, random, source):
    """Well-formed requests with strange values for what the service knows."""
    client = rig.client("anna", source, honest=False)
    job = next((job for job in list(rig.jobs.values()) if job.done and not job.deleted), None)
    name = job.id if job else "01900000-0000-7000-8000-000000000000"
    for method, path, body, fields in (
        ("GET", f"/v1/jobs/{name}", None, {"Prefer": "wait=99999999999999999999"}),
        ("GET", f"/v1/jobs/{name}/result?format=exe", None, {}),
        ("GET", f"/v1/jobs/{name}/result", None, {"Range": "bytes=18446744073709551615-"}),
        ("GET", f"/v1/jobs/{name}/exports/voxels?cells=99999999", None, {}),
        ("GET", f"/v1/jobs/{name}/exports/slice?at_mm=nan", None, {}),
        ("GET", "/v1/jobs?cursor=" + "A" * 500, None, {}),
        ("GET", "/v1/jobs?limit=-1&state=x&label==", None, {}),
        ("PATCH", f"/v1/jobs/{name}", {"expires_at": "9999-99-99"}, {"If-Match": "W/\"x\""}),
        ("POST", "/v1/jobs", {"seed": 1}, {"Idempotency-Key": "x" * 5000}),
        ("POST", "/v1/jobs", [1], {"Content-Encoding": "gzip"}),
        ("PUT", f"/v1/leases/{name}/1/result", {}, {}),
        ("POST", "/session", {"key": "x" * 100_000}, {"Sec-Fetch-Site": "same-origin"}),
    ):
        data = None if body is None else json.dumps(body).encode()
        client.ask(method, path, data, JSON_FIELDS | fields, timeout=20)


JSON_FIELDS = {"Content-Type": "application/json"}
ATTACKS = {
    attack.__name__: attack
    for attack in (
        slow_bodies, slow_heads, chunked_bodies, silent_connections, stalled_readers, malformed, hostile_json,
        cross_site, wrong_keys, absolute_targets, plans_at_once, resets, rare_fields,
        waiting_clients, same_order_at_once,
    )
}
