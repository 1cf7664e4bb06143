"""Clients that behave: they submit, follow, download, compare, cancel, retry, delete, and come back after a fault."""

import json
import random
import socket
import threading
import time

from . import bodies
from .jobs import FINAL, Job, first_bytes, judge_bytes, judge_document, lose
from .ledger import DOUBLED, LOST, RIGHTS, WRONG_BYTES
from .wire import LATER

FORMATS = ("npy", "csv", "view", "vtk", "json", "vtp", "html")
EXPORTS = (bodies.VOXELS, "slice?format=svg", "slice?format=json&at_mm=5", "quality", "shapes", "mesh?format=msh")
# Jobs of one client that wait or run, and that it keeps.
MOST_OPEN, MOST_KEPT = 4, 30


class Honest:
    """A client with jobs of its own."""

    def __init__(self, rig, number, seed):
        self.rig, self.number = rig, number
        self.random = random.Random(f"{seed} honest {rig.name} {number}")
        self.client = rig.client(("anna", "bert", "anna")[number % 3])
        self.jobs = []
        self.orders = 0

    def run(self):
        """Acts until the attacks end."""
        actions = {
            self.submit: 6, self.submit_again: 2, self.poll: 8, self.follow: 2, self.list: 1, self.download: 10,
            self.export: 4, self.cancel: 1, self.retry: 2, self.delete: 2, self.look_around: 1,
        }
        while not self.rig.stopping.is_set():
            action = self.random.choices(list(actions), actions.values())[0]
            action()
            # A client that was refused comes back a little later; one that was served, at once.
            self.rig.stopping.wait(self.random.uniform(0.0, 0.15))

    # Choices.

    def one(self, fits):
        """One of the jobs, at random."""
        found = [job for job in self.jobs if fits(job) and not job.lost and not job.deleted]
        return self.random.choice(found) if found else None

    def submit(self):
        """Submits a new job, if few are open; what was not acknowledged first."""
        unknown = [job for job in self.jobs if job.id is None]
        if unknown:
            return self.order(unknown[0])
        if sum(job.state not in FINAL for job in self.jobs) >= MOST_OPEN or len(self.jobs) >= MOST_KEPT:
            return None
        return self.submit_kind(*bodies.draw(self.random))

    def submit_kind(self, kind, seed=1):
        """Submits a new job of this kind."""
        key = f"{self.rig.name}-{self.number}-{self.orders}"
        self.orders += 1
        job = Job(key, kind, seed, bodies.body(kind, seed, key))
        self.jobs.append(job)
        with self.rig.lock:
            self.rig.jobs[key] = job
        return self.order(job)

    def submit_again(self):
        """Sends an order once more, as after an answer that was lost: it is one job."""
        job = self.one(lambda job: job.id is not None)
        if job:
            self.order(job)

    def order(self, job):
        """Sends the order of a job."""
        request = f"POST /v1/jobs, Idempotency-Key {job.key}"
        with self.rig.submitting_one():
            answer = self.client.ask("POST", "/v1/jobs", job.body, {"Idempotency-Key": job.key})
        document = self.accepted(answer, {200, 201}, request)
        if document is None:
            return
        if job.id is None:
            job.id, job.accepted_at = document["id"], time.monotonic()
            self.rig.ledger.count("jobs accepted")
        elif document["id"] != job.id:
            self.rig.ledger.broke(DOUBLED, self.rig.name, f"order {job.key} made {job.id} and another", request, answer)
            return
        if not job.deleted:
            judge_document(self.rig, job, document, request, answer)

    def accepted(self, answer, statuses, request):
        """The JSON of an answer with one of these statuses; every other one but "later" is a fault."""
        if answer is None or answer.status in LATER or not answer.whole:
            return None
        if answer.status in statuses:
            return answer.json()
        if answer.status in (401, 403, 404) and self.rig.has_key_trouble(time.monotonic()):
            return None
        if answer.status != 500:
            self.rig.broke_other(f"an unexpected answer of {answer.status}", request, answer)
        return None

    def document(self, job, headers=None):
        """Asks for a job and judges what comes."""
        path = f"/v1/jobs/{job.id}"
        answer = self.client.ask("GET", path, headers=headers)
        if answer is not None and answer.status == 404:
            self.missing(job, f"GET {path}", answer)
            return None
        document = self.accepted(answer, {200}, f"GET {path}")
        if document is not None:
            judge_document(self.rig, job, document, f"GET {path}", answer)
        return document

    def missing(self, job, request, answer):
        """A job that was accepted and is not there any more."""
        if job.deleted or self.rig.has_key_trouble(time.monotonic()):
            return
        lose(self.rig, job, "404", request, answer)

    def poll(self):
        """Asks for a job, sometimes waiting for its end."""
        job = self.one(lambda job: job.id is not None)
        if job:
            self.document(job, {"Prefer": "wait=2"} if self.random.random() < 0.3 else None)

    def follow(self):
        """Follows the events of a job for at most two seconds."""
        job = self.one(lambda job: job.id and job.state not in FINAL)
        if not job:
            return
        head = f"GET /v1/jobs/{job.id}/events HTTP/1.1\r\nHost: localhost\r\n"
        if self.client.key:
            head += f"Authorization: Bearer {self.client.key}\r\n"
        text = b""
        try:
            with socket.create_connection(("127.0.0.1", self.rig.port), timeout=1.0) as stream:
                stream.sendall(head.encode() + b"\r\n")
                until = time.monotonic() + 2
                while time.monotonic() < until and b'"succeeded"' not in text:
                    block = stream.recv(65536)
                    if not block:
                        break
                    text += block
        except OSError:
            pass
        if text.startswith(b"HTTP/1.1 500"):
            self.rig.judge_status(True, 500, head, text.decode(errors="replace"))
        self.rig.ledger.count("event streams followed")

    def list(self):
        """Reads pages of the list: no order has two jobs."""
        seen, cursor = {}, ""
        for _ in range(20):
            path = f"/v1/jobs?limit=50{cursor}"
            answer = self.client.ask("GET", path)
            page = self.accepted(answer, {200}, f"GET {path}")
            if page is None:
                return
            for item in page["items"]:
                order = item.get("labels", {}).get("order")
                if order and seen.setdefault(order, item["id"]) != item["id"]:
                    self.rig.ledger.broke(DOUBLED, self.rig.name, f"two jobs of order {order}", path, answer)
            if not page["next_cursor"]:
                return
            cursor = f"&cursor={page['next_cursor']}"

    def download(self):
        """Downloads a result in some format, whole, compressed or a part of it."""
        job = self.one(lambda job: job.done)
        if job:
            what = self.random.choice(FORMATS)
            self.fetch(job, what, f"/v1/jobs/{job.id}/result?format={what}")

    def export(self):
        """Downloads an export, which is made at its first request."""
        job = self.one(lambda job: job.done and job.kind != "large")
        if job:
            what = self.random.choice(EXPORTS)
            if what.startswith("mesh") and job.kind in ("equal", "polyhedra", "long"):
                return
            self.fetch(job, what, f"/v1/jobs/{job.id}/exports/{what}", {"Prefer": "wait=5"})

    def fetch(self, job, what, path, headers=None):
        """Gets a file or a part of it and compares it with what is known."""
        headers, span = dict(headers or {}), (0, 0)
        known = first_bytes(self.rig, job, what)
        if known and self.random.random() < 0.4:
            first = self.random.randrange(len(known))
            span = (first, min(len(known) - 1, first + self.random.randrange(1, 100_000)))
            headers["Range"] = f"bytes={span[0]}-{span[1]}"
        elif self.random.random() < 0.2:
            headers["Accept-Encoding"] = "gzip"
        began = time.monotonic()
        answer = self.client.ask("GET", path, headers=headers)
        request = f"GET {path} {headers}"
        if answer is None or answer.status in LATER or answer.status == 202:
            return
        if answer.status in (200, 206):
            judge_bytes(self.rig, job, what, span, answer, request)
        elif answer.status == 404:
            self.missing(job, request, answer)
        elif answer.status == 409 and "/exports/" in path:
            self.without_export(job, began, path, answer)
        elif answer.status in (409, 410):
            self.without_result(job, began, request, answer)
        else:
            self.accepted(answer, {200}, request)

    def without_export(self, job, began, path, answer):
        """An export failed: it may have met a fault. It is deleted, and requested again by a later action."""
        self.client.ask("DELETE", path)
        if job.is_damaged(began) or job.retried or job.id in self.rig.removed:
            return
        job.failed_exports += 1
        self.rig.ledger.count("exports that failed beside a fault")
        if job.failed_exports > 5:
            self.rig.broke_other(f"exports of {job.id} fail again and again", f"GET {path}", answer)

    def without_result(self, job, began, request, answer):
        """The file of a result is missing or damaged, or an export of it failed: is it the work of these tests?"""
        if job.is_damaged(began) or job.retried or self.rig.windows.allows(began, time.monotonic(), 0.5):
            self.rig.ledger.count("damaged files reported")
            return
        if job.id in self.rig.removed:
            job.damage()
            return
        lose(self.rig, job, "its result is not there", request, answer)

    def cancel(self):
        """Cancels a job that has not ended."""
        job = self.one(lambda job: job.id and job.state not in FINAL)
        if not job:
            return
        job.cancelled = True
        self.accepted(self.client.ask("POST", f"/v1/jobs/{job.id}/cancel"), {200, 202, 409}, f"cancel {job.id}")

    def retry(self, job=None):
        """Retries a job that was cancelled or failed, or whose result is damaged."""
        job = job or self.one(lambda job: job.id and (job.state in ("cancelled", "failed") or job.damaged))
        if not job:
            return
        damaged, before, unanswered = job.damaged, job.done, job.retried
        job.retried = True
        answer = self.client.ask("POST", f"/v1/jobs/{job.id}/retry")
        document = self.accepted(answer, {200, 409}, f"retry {job.id}")
        if answer is not None and answer.status == 409:
            # A retry before it, which went unanswered, may have started the job again.
            job.retried = unanswered
        # With 503 or without an answer, the service may have retried it: it answers what it knows to have lasted.
        elif document is not None:
            job.cancelled = False
            job.state = "queued"
            self.rig.ledger.count("jobs retried")
            if damaged and job.done == before:
                job.done = None
                job.heal()

    def delete(self):
        """Deletes a job that has ended; its result is compared once more before."""
        unanswered = [job for job in self.jobs if job.deleted]
        if not unanswered and len(self.jobs) < MOST_KEPT // 2:
            return
        job = unanswered[0] if unanswered else self.one(lambda job: job.id and job.state in FINAL)
        if not job:
            return
        if job.done and not job.deleted:
            self.fetch(job, "npy", f"/v1/jobs/{job.id}/result?format=npy")
        job.deleted = True
        answer = self.client.ask("DELETE", f"/v1/jobs/{job.id}")
        self.accepted(answer, {204, 404, 409}, f"DELETE {job.id}")
        status = answer.status if answer else None
        if status in (204, 404) and not self.rig.has_key_trouble(time.monotonic()):
            self.jobs.remove(job)
            with self.rig.lock:
                self.rig.jobs.pop(job.key, None)
            self.rig.ledger.count("jobs deleted")
        elif status == 409:
            # A retry that went unanswered has started it again.
            job.deleted = False
            job.cancelled = job.retried = True
            self.client.ask("POST", f"/v1/jobs/{job.id}/cancel")

    def tidy(self):
        """Looks for all of the jobs, and deletes some of those that have ended."""
        for job in list(self.jobs):
            if job.id and not job.deleted and not job.lost:
                self.document(job)
        while len(self.jobs) > MOST_KEPT // 2 and not self.rig.stopping.is_set():
            before = len(self.jobs)
            self.delete()
            if len(self.jobs) == before:
                return

    def look_around(self):
        """What a page of the service asks for."""
        path = self.random.choice(["/v1/capabilities", "/v1/key", "/", "/v1/studies", "/healthz"])
        answer = self.client.ask("GET", path)
        document = self.accepted(answer, {200}, f"GET {path}")
        if path == "/v1/key" and document and self.rig.with_keys and document["role"] not in ("submit",):
            self.rig.ledger.broke(RIGHTS, self.rig.name, f"a submit key is {document}", path, answer)


class Studies:
    """A client that submits small studies and reads their tables."""

    def __init__(self, rig, seed):
        self.rig = rig
        self.random = random.Random(f"{seed} studies {rig.name}")
        self.client = rig.client("bert")
        self.orders = 0

    def run(self):
        """One study after the other."""
        while not self.rig.stopping.is_set():
            self.one()
            self.rig.stopping.wait(1.0)

    def one(self):
        """Submits a study, waits for its end, and reads its table twice."""
        key = f"{self.rig.name}-study-{self.orders}"
        self.orders += 1
        body = bodies.study(self.random.choice(["quick", "equal", "growth"]), key)
        document = self.until({200, 201}, "POST", "/v1/studies", body, {"Idempotency-Key": key})
        if document is None:
            return
        identity = document["id"]
        self.rig.ledger.count("studies accepted")
        self.rig.studies[key] = identity
        path = f"/v1/studies/{identity}"
        while not self.rig.stopping.is_set():
            document = self.until({200}, "GET", path, None, {"Prefer": "wait=5"})
            if document and sum(document["counts"].get(name, 0) for name in FINAL) >= 3:
                break
            self.rig.stopping.wait(0.2)
        else:
            return
        if document["counts"]["succeeded"] != 3:
            self.rig.broke_other(f"a study ended with {document['counts']}", path, json.dumps(document))
        listed = self.until({200}, "GET", f"{path}/jobs?limit=50")
        if listed and len({(item["point"], item["replicate"]) for item in listed["items"]}) != 3:
            self.rig.ledger.broke(DOUBLED, self.rig.name, f"study {identity} has other jobs than three", path, listed)
        first = self.until({200}, "GET", f"{path}/table?format=csv", raw=True)
        second = self.until({200}, "GET", f"{path}/table?format=csv", raw=True)
        if first and second and first != second:
            self.rig.ledger.broke(WRONG_BYTES, self.rig.name, f"the table of study {identity} has changed")
        if self.until({204, 404}, "DELETE", path, raw=True) is not None:
            self.rig.studies.pop(key, None)

    def until(self, statuses, method, path, body=None, headers=None, raw=False):
        """Asks until the answer is none of "later"; `None` at the end of the attacks."""
        while not self.rig.stopping.is_set():
            with self.rig.submitting_one():
                answer = self.client.ask(method, path, body, headers)
            if answer is not None and answer.whole and answer.status not in LATER:
                if answer.status in statuses:
                    return answer.body if raw else answer.json()
                if answer.status == 404 and not self.rig.has_key_trouble(time.monotonic()):
                    self.rig.ledger.broke(LOST, self.rig.name, "a study", f"{method} {path}", answer)
                    return None
                if answer.status not in (401, 403, 404, 500):
                    self.rig.broke_other(f"an unexpected answer of {answer.status}", f"{method} {path}", answer)
                    return None
            self.rig.stopping.wait(0.3)
        return None


def start(rig, seed, number):
    """Starts so many clients and one with studies; returns all with their threads. The last one is for the faults."""
    clients = [Honest(rig, index, seed) for index in range(number)]
    rig.spare_client = Honest(rig, number, seed)
    loops = [client.run for client in [*clients, Studies(rig, seed)]]
    threads = [threading.Thread(target=rig.guarded, args=(loop,), daemon=True) for loop in loops]
    for thread in threads:
        thread.start()
    return [*clients, rig.spare_client], threads
