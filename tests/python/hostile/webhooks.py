"""Receivers of webhooks on this machine: one that works, and hosts that accept and never answer."""

import base64
import hmac
import re
import socket
import subprocess
import threading
import time

from . import bodies

HANGING = [f"127.0.77.{number}" for number in range(1, 61)]
GOOD = "127.0.78.1"
# A good host gets its message within seconds; this is the bound on a machine that is busy with everything else here.
MOST_S = 15.0


class Receivers:
    """A listener for each host, all on one port of the loopback network."""

    def __init__(self):
        self.held, self.delivered, self.unsigned = [], set(), 0
        self.secret = self.key = None
        for _ in range(20):
            listeners = self._listen()
            if listeners:
                break
        else:
            raise SystemExit("no port that is free on all loopback addresses")
        for listener in listeners:
            threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def _listen(self):
        """A socket for each host; none where one of them has no such port."""
        found, port = [], 0
        for host in (GOOD, *HANGING):
            listener = socket.socket()
            found.append(listener)
            try:
                listener.bind((host, port))
            except OSError:
                for taken in found:
                    taken.close()
                return []
            listener.listen(50)
            port = self.port = listener.getsockname()[1]
        return found

    def options(self, binary, folder):
        """The options of a service that may send here."""
        if self.secret is None:
            made = subprocess.run([binary, "webhook-secret"], capture_output=True, text=True, check=True)
            self.secret = made.stdout
            self.key = base64.b64decode(self.secret.strip().removeprefix("whsec_"))
        file = folder / "webhook-secret"
        file.write_text(self.secret)
        return ["--webhook-secret-file", file, "--webhook-allowed-host", ",".join([*HANGING, GOOD])]

    def _accept(self, listener):
        while True:
            connection, _ = listener.accept()
            if connection.getsockname()[0] == GOOD:
                threading.Thread(target=self._answer, args=(connection,), daemon=True).start()
            else:
                self.held.append(connection)
                if len(self.held) > 200:
                    self.held.pop(0).close()

    def _answer(self, connection):
        connection.settimeout(5)
        data = b""
        try:
            while b"\r\n\r\n" not in data or not data.endswith(b"}"):
                block = connection.recv(65536)
                if not block:
                    return
                data += block
            if self._is_signed(data):
                self.delivered.add(re.match(rb"POST /(\S+) ", data).group(1).decode())
                connection.sendall(b"HTTP/1.1 204 No Content\r\n\r\n")
            else:
                self.unsigned += 1
                connection.sendall(b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n")
        except OSError:
            pass
        finally:
            connection.close()

    def _is_signed(self, data):
        """Whether a message has the signature of the secret (Standard Webhooks)."""
        head, _, body = data.partition(b"\r\n\r\n")
        fields = {name.lower(): value for name, value in re.findall(rb"\r\n(webhook-[a-z]+): *([^\r]*)", head, re.I)}
        text = fields[b"webhook-id"] + b"." + fields[b"webhook-timestamp"] + b"." + body
        right = b"v1," + base64.b64encode(hmac.digest(self.key, text, "sha256"))
        return right in fields[b"webhook-signature"].split()

    def attack(self, rig, random):
        """Many messages to hosts that hang, and one to a good one, which is not held up."""
        client = rig.client("anna")
        mark = f"{rig.name}-{random.randrange(1 << 30)}"

        def submit(host):
            url = {"webhook_url": f"http://{host}:{self.port}/{mark}"}
            job = bodies.body("quick", 1, f"webhook-{mark}-{host}") | url
            for _ in range(40):
                answer = client.ask("POST", "/v1/jobs", job, {"Idempotency-Key": f"webhook-{mark}-{host}"})
                if answer and answer.status in (200, 201):
                    return answer.json()["id"]
                rig.stopping.wait(0.3)
            return None

        # Cut as a full disk would: what is left may be a secret, of fewer bytes.
        file, unsigned = rig.folder / "webhook-secret", self.unsigned
        if random.random() < 0.7:
            file.write_text(self.secret[: len("whsec_") + random.choice([10, 32, 36, 40])])
        made = [submit(host) for host in HANGING]
        good = submit(GOOD)
        made.append(good)
        began = time.monotonic()
        while good and mark not in self.delivered and time.monotonic() < began + MOST_S and not rig.stopping.is_set():
            rig.stopping.wait(0.1)
        took = time.monotonic() - began
        rig.ledger.peak("longest time to a webhook beside hosts that hang, s", round(took, 1))
        if good and mark not in self.delivered and not rig.stopping.is_set():
            rig.broke_other(f"a webhook was not delivered within {took:.0f} s beside hosts that hang")
        if self.unsigned > unsigned:
            rig.broke_other("a webhook was signed by a part of its secret")
        file.write_text(self.secret)
        for identity in filter(None, made):
            rig.remove(client, identity)
