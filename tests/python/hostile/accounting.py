"""The end: no more attacks, and every accepted job is looked for, compared, and counted."""

import subprocess
import threading
import time

from .jobs import FINAL, lose
from .ledger import DOUBLED
from .rig import environment

# Time for all of it. Jobs that an earlier fault made wait may be unfinished at its end.
MOST_S = 27.0
# Shares of it: for the ends of attacks, and at the end for the comparison of results, the stop and the check.
JOINS_S, STOP_S = 10.0, 8.0
# A job that waits for longer after a fault than the longest pause (10 min) is stuck.
STUCK_S = 900.0


def finish(rigs, clients, threads):
    """Ends the clients, and accounts for all jobs of all rigs at the same time."""
    deadline = time.monotonic() + MOST_S
    for rig in rigs:
        rig.stopping.set()
    for rig in rigs:
        for thread in threads[rig.name]:
            thread.join(max(0.1, deadline - MOST_S + JOINS_S - time.monotonic()))
            if thread.is_alive():
                rig.ledger.count("threads of these tests that did not end in time")
    accounts = [
        threading.Thread(target=rig.guarded, args=(lambda rig=rig: _account(rig, clients[rig.name], deadline),))
        for rig in rigs
    ]
    for account in accounts:
        account.start()
    for account in accounts:
        account.join()


def _account(rig, clients, deadline):
    """Looks for all jobs of a rig."""
    if rig.is_dead:
        return
    if rig.service.poll() is not None and not rig.start_or_report("for the accounting"):
        return
    if rig.worker.poll() is not None:
        rig.start_worker()
    _await_ready(rig, deadline)
    for client in clients:
        for job in client.jobs:
            if job.id is None:
                client.order(job)
    all_jobs = [(client, job) for client in clients for job in client.jobs]
    open_jobs = [(client, job) for client, job in all_jobs if job.id and not job.deleted and not job.lost]
    while open_jobs and time.monotonic() < deadline - STOP_S - 2:
        # Every job is there, and ends.
        for client, job in open_jobs:
            if job.damaged:
                client.retry(job)
            client.document(job)
            if time.monotonic() > deadline - STOP_S - 1:
                break
        open_jobs = [(client, job) for client, job in open_jobs if job.state not in FINAL and not job.lost]
        if open_jobs:
            time.sleep(0.3)
    rig.ledger.count("jobs unfinished at the end", len(open_jobs))
    for _, job in open_jobs:
        if time.monotonic() - job.accepted_at > STUCK_S:
            lose(rig, job, f"it is {job.state} {time.monotonic() - job.accepted_at:.0f} s after it was accepted")
    for client in clients:
        for job in client.jobs:
            if job.done and not (job.deleted or job.lost) and time.monotonic() < deadline - STOP_S + 2:
                client.fetch(job, "npy", f"/v1/jobs/{job.id}/result?format=npy")
                rig.ledger.count("results compared at the end")
    _list_all(rig, clients)
    _check(rig, clients, deadline)


def _await_ready(rig, deadline):
    """Waits for the service to be ready."""
    client, answer = rig.client(honest=False), None
    while time.monotonic() < deadline - STOP_S:
        answer = client.ask("GET", "/readyz", timeout=5)
        if answer and answer.status == 200:
            return
        time.sleep(0.2)
    rig.broke_other("the service is not ready at the end", "GET /readyz", answer or "none")


def _list_all(rig, clients):
    """The list has each job of each order once, and no order twice."""
    found, cursor, client = {}, "", rig.client("root")
    while True:
        path = f"/v1/jobs?limit=100{cursor}"
        answer = client.ask("GET", path)
        if answer is None or answer.status != 200:
            rig.broke_other("the list cannot be read at the end", path, answer or "none")
            return
        page = answer.json()
        for item in page["items"]:
            order = item.get("labels", {}).get("order")
            if order and found.setdefault(order, item["id"]) != item["id"]:
                rig.ledger.broke(DOUBLED, rig.name, f"{item['id']} and {found[order]} are both order {order}", path)
        if not page["next_cursor"]:
            break
        cursor = f"&cursor={page['next_cursor']}"
    for client in clients:
        for job in client.jobs:
            if job.id and not job.deleted and not job.lost and found.get(job.key) != job.id:
                lose(rig, job, "the list does not have it", path)


def _check(rig, clients, deadline):
    """Ends the service in order, and lets `packstone check` read the whole store."""
    rig.worker.terminate()
    rig.stop()
    damaged = any(job.damaged for client in clients for job in client.jobs)
    now = time.monotonic()
    if damaged or now > deadline:
        rig.ledger.count("stores not checked at the end, for a damaged file or want of time")
        return
    command = [rig.binary, "check", rig.data, *(["--blobs", rig.blobs] if rig.blobs else [])]
    most_s = max(1, deadline - now)
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, check=False, env=environment(), timeout=most_s
        )
    except subprocess.TimeoutExpired:
        rig.ledger.count("stores not checked at the end, for a damaged file or want of time")
        return
    rig.ledger.count("stores checked at the end")
    said = ended.stdout + ended.stderr
    named = [line for line in said.splitlines() if ".packstone" in line or ".export" in line or ".sqlite" in line]
    faults = [line for line in named if not any(job in line for job in rig.removed)]
    if rig.results_were_away:
        # What was deleted meanwhile came back with the folder, until it is moved to the quarantine.
        faults = [line for line in faults if "does not know" not in line]
    if ended.returncode != 0 and (faults or not named):
        rig.broke_other("packstone check finds faults at the end", "", "\n".join(faults) or said[-700:])
