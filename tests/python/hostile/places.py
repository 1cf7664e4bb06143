"""Places that are moved, replaced, locked, full, or something else than they were while the service runs."""

import os
import shutil
import sqlite3
import subprocess
import threading
import time

from . import bodies, flips
from .rig import MOST_START_S, environment

# A service that finds its store moved or replaced ends by itself within this time.
MOST_END_S = 20.0
# An answer beside a file that cannot be written takes no longer, on a busy machine either.
MOST_ANSWER_S = 15.0


def await_end(rig, seconds):
    """Waits until the service ends by itself; whether it does. It must, where it has all the time."""
    end = time.monotonic() + seconds
    while rig.service.poll() is None:
        if time.monotonic() > end or rig.stopping.wait(0.05):
            break
    else:
        rig.ledger.count("services that ended because their store was away")
        return True
    if seconds == MOST_END_S and not rig.stopping.is_set():
        rig.broke_other(f"the service did not end within {seconds:g} s after its store was moved or replaced")
    return False


def _put_back(rig, random, what, put_back):
    """Lets the service run without its store for a time, ends it if it does not, and puts the store back."""
    if not await_end(rig, random.choice([0.5, 2, MOST_END_S])):
        rig.kill()
    put_back()
    rig.start_or_report(f"after its {what} and put back")


def data_moved(rig, random):
    """The data directory is moved away and, later, back."""
    with rig.windows.open("moved"):
        away = rig.disk / "away"
        rig.results_were_away = True
        os.rename(rig.data, away)

        def put_back():
            # What was made in its place is none of the store's.
            shutil.rmtree(rig.data, ignore_errors=True)
            os.rename(away, rig.data)

        _put_back(rig, random, "data directory was moved", put_back)


def database_replaced(rig, random):
    """The database is replaced by a copy of itself and, later, put back."""
    with rig.windows.open("replaced"):
        database, kept = rig.data / "packstone.sqlite", rig.disk / "kept"
        os.link(database, kept)
        shutil.copy(database, rig.data / "copy")
        os.replace(rig.data / "copy", database)
        _put_back(rig, random, "database was replaced", lambda: os.replace(kept, database))


def database_removed(rig, random):
    """The name of the database is removed and, later, put back."""
    with rig.windows.open("removed"):
        database, kept = rig.data / "packstone.sqlite", rig.disk / "kept"
        os.rename(database, kept)
        _put_back(rig, random, "database was removed", lambda: os.replace(kept, database))


def log_of_database_moved(rig, random):
    """The name of the write-ahead log is removed and, later, put back."""
    with rig.windows.open("removed"):
        log, kept = rig.data / "packstone.sqlite-wal", rig.disk / "kept"
        if not log.exists():
            return
        os.rename(log, kept)
        # Until the service has noticed: at the next look, each second.
        if not await_end(rig, random.choice([0.5, 2])):
            rig.kill()
        os.replace(kept, log)
        rig.start_or_report("after the log of its database was moved and put back")


def database_locked(rig, random):
    """Another program holds the lock of the database for some seconds."""
    with rig.windows.open("locked"):
        other = sqlite3.connect(rig.data / "packstone.sqlite", timeout=20, isolation_level=None)
        try:
            other.execute("begin immediate")
            rig.stopping.wait(random.choice([1, 4, 8]))
            other.execute("rollback")
        except sqlite3.OperationalError:
            rig.ledger.count("locks that were not had")
        finally:
            other.close()


def results_moved(rig, random):
    """The folder of results is moved away and back; sometimes an empty one is in its place meanwhile."""
    with rig.windows.open("results moved"):
        folder, away, empty = rig.blobs, rig.disk / "away", random.random() < 0.5
        rig.results_were_away = True
        os.rename(folder, away)
        if empty:
            folder.mkdir(exist_ok=True)
        rig.stopping.wait(random.uniform(1, 4))
        for file in rig.files_below(folder):
            # Results that were written meanwhile go with the folder.
            if file.suffix == ".packstone":
                flips.remember_removed(rig, file)
        shutil.rmtree(folder, ignore_errors=True)
        os.rename(away, folder)
        if rig.service.poll() is not None:
            rig.start_or_report("after its results were moved away and back")


def full_disk(rig, random):
    """No space is left on the disk of the store, for some seconds."""
    with rig.windows.open("full disk"):
        if not rig.has_disk:
            rig.limit_files(4096)
            rig.stopping.wait(random.uniform(1, 4))
            rig.limit_files(None)
            return
        filler = rig.disk / "filler"
        end = time.monotonic() + random.uniform(1, 4)
        try:
            with filler.open("ab", buffering=0) as out:
                # What the service gives back meanwhile is taken as well.
                while time.monotonic() < end and not rig.stopping.is_set():
                    for size in (1 << 20, 1 << 12, 1):
                        try:
                            while out.write(bytes(size)) == size and time.monotonic() < end:
                                pass
                        except OSError:
                            continue
                    rig.stopping.wait(0.1)
        finally:
            filler.unlink()


def second_service(rig, random):
    """Another service is started on the same data directory, or with the same place of results: it is refused."""
    other = rig.folder / "second"
    shared = rig.blobs is not None and random.random() < 0.7
    command = [rig.binary, "serve", "--listen", "127.0.0.1:0", "--data-dir", other if shared else rig.data]
    if rig.blobs:
        command += ["--blobs", rig.blobs]
    said = rig.folder / "second.log"
    with said.open("wb") as log:
        service = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment(), restore_signals=False
        )
    end = time.monotonic() + MOST_START_S
    while service.poll() is None and b"http://" not in said.read_bytes() and time.monotonic() < end:
        time.sleep(0.05)
    if service.poll() is None:
        what = "place of results" if shared else "data directory"
        rig.broke_other(f"a second service on one {what} is not refused", command, said.read_bytes()[-500:])
        service.kill()
    elif service.returncode == 0 or b"panicked" in said.read_bytes():
        rig.broke_other(f"a second service ends with {service.returncode}", command, said.read_bytes()[-500:])
    service.wait()
    shutil.rmtree(other, ignore_errors=True)


def audit_log_hangs(rig, random):
    """The audit log becomes a pipe that nobody reads: no answer waits for it."""
    if not rig.with_keys:
        return
    audit = rig.folder / "audit"
    audit.unlink(missing_ok=True)
    os.mkfifo(audit)
    try:
        if is_served(rig, "an audit log that hangs"):
            body = bodies.body("quick", 1, f"audit-{random.randrange(1 << 40)}")
            answer = rig.client("anna", honest=False).ask("POST", "/v1/jobs", body, timeout=MOST_ANSWER_S)
            if answer is None:
                rig.broke_other(f"a submission waits {MOST_ANSWER_S:g} s for an audit log that hangs")
    finally:
        # A writer that waits for a reader is released by one.
        reader = os.open(audit, os.O_RDONLY | os.O_NONBLOCK)
        audit.unlink()
        time.sleep(0.2)
        os.close(reader)


def standard_error_fails(rig, random):
    """Standard error is a pipe that is closed, or that nobody reads any more: no answer waits for it."""
    reader, writer = os.pipe()
    is_closed = random.random() < 0.5
    with rig.windows.open("restart"):
        rig.stop()
        rig.start_or_report("with a pipe for standard error", log=writer)
    os.close(writer)
    if is_closed:
        os.close(reader)
    # Some requests, until the pipe is full: 64 KiB.
    client = rig.client("anna", honest=False)
    for _ in range(300):
        if client.ask("GET", "/v1/jobs?limit=1", timeout=MOST_ANSWER_S) is None or rig.stopping.is_set():
            break
    is_served(rig, "standard error that is closed" if is_closed else "standard error that nobody reads")
    with rig.windows.open("restart"):
        # It ends in order without a reader.
        rig.stop()
        if not is_closed:
            os.close(reader)
        rig.start_or_report("after it had a pipe for standard error")


def is_served(rig, beside):
    """Whether an honest client is served beside a fault or an attack: reads, plans, and a change."""
    client = rig.client("anna")
    plan = {"specimen": {"type": "box", "size_mm": [40, 40, 40]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}}
    for method, path, body in (("GET", "/v1/jobs?limit=1", None), ("POST", "/v1/plans", plan)):
        answers = []

        def ask(answers=answers, method=method, path=path, body=body):
            end = time.monotonic() + MOST_ANSWER_S
            while time.monotonic() < end and not rig.stopping.is_set():
                answer = client.ask(method, path, body, timeout=MOST_ANSWER_S)
                answers.append(answer.status if answer else None)
                if answer and answer.status == 200:
                    return
                rig.stopping.wait(0.2)

        began = time.monotonic()
        asking = threading.Thread(target=ask, daemon=True)
        asking.start()
        asking.join(MOST_ANSWER_S + 5)
        now = time.monotonic()
        if 200 not in answers and not rig.stopping.is_set() and not rig.windows.allows(began, now, 10):
            if not rig.has_key_trouble(began):
                rig.broke_other(f"beside {beside} {method} {path} is not served within {now - began:.0f} s", answers)
                return False
        rig.ledger.peak("longest time to an answer beside attacks, ms", int(1000 * (now - began)))
    return True
