"""What honest clients know of the jobs that were accepted, and the judgement of each answer about one."""

import gzip
import json
import time

from .bodies import PURE, VOXELS
from .ledger import DOUBLED, LOST, WRONG_BYTES

# A damaged file that was put right may be reported as damaged by a request that was on its way.
HEALED_S = 5.0
FINAL = ("succeeded", "failed", "cancelled")


class Job:
    """A job that a client wants: its idempotency key, and all that was acknowledged of it."""

    def __init__(self, key, kind, seed, body):
        self.key, self.kind, self.seed, self.body = key, kind, seed, body
        self.id = None
        self.accepted_at = None
        self.state = "unknown"
        self.done = None
        self.cancelled = self.retried = False
        self.deleted = self.lost = False
        self.failed_exports = 0
        # First bytes of formats and exports that contain times or the ID.
        self.firsts = {}
        # A file of it is damaged or missing at present; when it was put right.
        self.damaged = False
        self.healed_at = -1e9

    def is_damaged(self, began):
        """Whether a request that began then may find a file of the job damaged."""
        return self.damaged or time.monotonic() - self.healed_at < HEALED_S or self.healed_at >= began

    def damage(self):
        """Its result is damaged from now on."""
        self.damaged = True

    def heal(self):
        """Its result is whole again."""
        self.healed_at = time.monotonic()
        self.damaged = False


def lose(rig, job, why, request="", answer=""):
    """Counts a lost job once."""
    if not job.lost:
        job.lost = True
        rig.ledger.broke(LOST, rig.name, f"{job.id} ({job.kind}, order {job.key}): {why}", request, answer)


def judge_document(rig, job, document, request, answer):
    """Holds the document of a job against what is known of it."""
    if document.get("id") != job.id or document.get("labels") != job.body["labels"]:
        rig.ledger.broke(WRONG_BYTES, rig.name, f"another document than that of {job.id}", request, answer)
        return
    if document.get("seed") != job.seed:
        rig.ledger.broke(WRONG_BYTES, rig.name, f"the seed of {job.id} is no longer {job.seed}", request, answer)
        return
    state = document["state"]
    if state == "succeeded":
        done = (document["attempt"], document["result"]["sha256"])
        if job.done and job.done != done and not job.retried:
            rig.ledger.broke(DOUBLED, rig.name, f"{job.id} succeeded as {job.done} and as {done}", request, answer)
        if job.done != done:
            job.firsts.clear()
        job.done, job.retried = done, False
    elif job.done and not job.retried:
        lose(rig, job, f"it had succeeded and is {state} now", request, answer)
    elif state == "failed":
        kind = document["error"]["type"]
        if kind != "/problems/attempts-exhausted":
            lose(rig, job, f"it failed with {kind}", request, answer)
    elif state == "cancelled" and not job.cancelled:
        lose(rig, job, "it was cancelled by nobody", request, answer)
    job.state = state


def first_bytes(rig, job, what):
    """The bytes that a format or an export must have; `None` where they are not known yet."""
    if what in PURE or what == VOXELS:
        return rig.references.bytes_of(job.kind, job.seed, what) or rig.pure.get((job.kind, job.seed, what))
    return job.firsts.get(what)


def judge_bytes(rig, job, what, span, answer, request):
    """Compares what came of a file with its first bytes, and keeps those."""
    body = answer.body
    if answer.headers.get("content-encoding") == "gzip":
        if not answer.whole:
            return
        try:
            body = gzip.decompress(body)
        except (OSError, EOFError) as error:
            rig.ledger.broke(WRONG_BYTES, rig.name, f"{job.id}, {what}: gzip: {error}", request, answer.headers)
            return
    known = first_bytes(rig, job, what)
    rig.ledger.count("downloads compared")
    rig.ledger.count("bytes compared", len(body))
    if known is None:
        if answer.whole and answer.status == 200:
            keep(rig, job, what, body)
        return
    expected = known[span[0] : span[1] + 1] if answer.status == 206 else known
    right = body == expected if answer.whole else expected.startswith(body)
    if not right:
        at = next((i for i, (a, b) in enumerate(zip(body, expected)) if a != b), min(len(body), len(expected)))
        what_differs = f"{job.id} ({job.kind}), {what}: byte {at} of {len(expected)} differs ({len(body)} came)"
        rig.ledger.broke(WRONG_BYTES, rig.name, what_differs, request, f"{answer.status} {answer.headers}")


def keep(rig, job, what, body):
    """Keeps the first bytes of a file."""
    if what in PURE or what == VOXELS:
        rig.pure[job.kind, job.seed, what] = body
    elif len(body) < 1 << 20:
        job.firsts[what] = body
    if what == "json":
        try:
            json.loads(body)
        except ValueError:
            rig.ledger.broke(WRONG_BYTES, rig.name, f"{job.id}: the result is no JSON")
