"""Faults of the machine and of the store, one after the other, and the moment when each is over."""

import os
import shutil
import signal
import time

from . import copies, flips
from .ledger import RIGHTS

# Ranks of roles: a damaged file of keys may take rights away, and never give any.
RANKS = {"metrics": 0, "worker": 0, "read": 1, "submit": 2, "admin": 3}
# A service that finds its store moved or replaced ends by itself within this time.
MOST_END_S = 20.0


def run(rig, random, until, only):
    """Injects each fault once in an order that is drawn, and again."""
    names = [name for name in FAULTS if not only or name in only]
    names = [name for name in names if rig.with_keys or name not in ("keys_cut", "keys_flipped")]
    names = [name for name in names if not rig.with_keys or name not in ("blobs_moved", "webhooks_hang")]
    while names and not rig.stopping.is_set():
        random.shuffle(names)
        for name in names:
            if time.monotonic() > until - 6:
                return
            rig.stopping.wait(random.uniform(0.5, 2.0))
            rig.ledger.event(name)
            with rig.lifecycle:
                began = time.monotonic()
                FAULTS[name](rig, random)
            rig.ledger.count("seconds of faults", round(time.monotonic() - began, 1))


def kill_service(rig, random):
    """SIGKILL of the service, and a new start."""
    with rig.windows.open("kill"):
        rig.kill()
        rig.stopping.wait(random.uniform(0, 0.5))
        rig.start_or_report("after SIGKILL")


def kill_often(rig, random):
    """SIGKILL of the service, several times shortly after its start."""
    with rig.windows.open("kill"):
        for _ in range(random.randrange(2, 5)):
            rig.kill()
            if not rig.start_or_report("after SIGKILL"):
                return
            rig.stopping.wait(random.uniform(0, 0.3))


def restart(rig, random):
    """SIGTERM, and a new start."""
    with rig.windows.open("restart"):
        rig.stop()
        rig.start_or_report("after SIGTERM")


def kill_worker(rig, random):
    """SIGKILL of the worker process, and a new one."""
    rig.worker.kill()
    rig.worker.wait()
    rig.ledger.count("workers killed")
    rig.stopping.wait(random.uniform(0, 2))
    rig.start_worker()


def stop_service(rig, random):
    """SIGSTOP of the service, and SIGCONT."""
    with rig.windows.open("stop"):
        rig.service.send_signal(signal.SIGSTOP)
        rig.stopping.wait(random.uniform(0.5, 3))
        rig.service.send_signal(signal.SIGCONT)


def stop_worker(rig, random):
    """SIGSTOP of the worker, sometimes for longer than its lease, and SIGCONT."""
    rig.worker.send_signal(signal.SIGSTOP)
    rig.stopping.wait(random.choice([0.5, 2, 7.5]))
    rig.worker.send_signal(signal.SIGCONT)


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


def data_moved(rig, random):
    """The data directory is moved away and, later, back."""
    with rig.windows.open("moved"):
        away = rig.disk / "away"
        os.rename(rig.data, away)
        ended = await_end(rig, random.choice([0.5, 2, MOST_END_S]))
        # What may have been made in its place is none of the store's.
        shutil.rmtree(rig.data, ignore_errors=True)
        os.rename(away, rig.data)
        if not ended:
            rig.kill()
        rig.start_or_report("after its store was moved away and back")


def database_replaced(rig, random):
    """The database is replaced by a copy of itself and, later, put back."""
    with rig.windows.open("replaced"):
        database, kept = rig.data / "packstone.sqlite", rig.data / "kept"
        os.link(database, kept)
        shutil.copy(database, rig.data / "copy")
        os.replace(rig.data / "copy", database)
        ended = await_end(rig, random.choice([0.5, 2, MOST_END_S]))
        if not ended:
            rig.kill()
        os.replace(kept, database)
        rig.start_or_report("after its database was replaced and put back")


def database_removed(rig, random):
    """The name of the database is removed and, later, put back."""
    with rig.windows.open("removed"):
        database, kept = rig.data / "packstone.sqlite", rig.disk / "kept"
        os.rename(database, kept)
        ended = await_end(rig, random.choice([0.5, 2, MOST_END_S]))
        if not ended:
            rig.kill()
        os.replace(kept, database)
        rig.start_or_report("after its database was removed and put back")


def blobs_moved(rig, random):
    """The folder of results is moved away and back; sometimes an empty one is in its place meanwhile."""
    with rig.windows.open("blobs moved"):
        away, empty = rig.disk / "away", random.random() < 0.5
        os.rename(rig.blobs, away)
        if empty:
            for folder in ("artifacts", "checkpoints"):
                (rig.blobs / folder).mkdir(parents=True, exist_ok=True)
        rig.stopping.wait(random.uniform(1, 4))
        for file in rig.blobs.glob("artifacts/*/*") if rig.blobs.exists() else ():
            # Results that were written meanwhile go with the folder.
            flips.job_of_file(rig, file, lambda job: job.damage())
        shutil.rmtree(rig.blobs, ignore_errors=True)
        os.rename(away, rig.blobs)
        if rig.service.poll() is not None:
            rig.start_or_report("after its blobs were moved away and back")


def keys_cut(rig, random):
    """The file of keys ends anywhere, as when it is being written."""
    _keys_are(rig, rig.keys_text[: random.randrange(len(rig.keys_text))])


def keys_flipped(rig, random):
    """A bit of the file of keys is another one."""
    text = bytearray(rig.keys_text)
    text[random.randrange(len(text))] ^= 1 << random.randrange(7)
    _keys_are(rig, bytes(text))


def _keys_are(rig, text):
    """Lets the file of keys be this for a while: no key has more rights than its line said."""
    with rig.no_submissions(), rig.key_windows.open("keys"), rig.windows.open("keys"):
        before = rig.keys_file.stat()
        rig.keys_file.write_bytes(text)
        if len(text) == before.st_size:
            # Its time and length stay the same, as for a disk that forgets.
            os.utime(rig.keys_file, ns=(before.st_atime_ns, before.st_mtime_ns))
        end = time.monotonic() + 2.5
        while time.monotonic() < end and not rig.stopping.is_set():
            for name, (_, role, owner) in rig.keys.items():
                answer = rig.client(name, honest=False).ask("GET", "/v1/key")
                found = answer.json() if answer and answer.status == 200 else None
                if not found:
                    continue
                others = {other for _, _, other in rig.keys.values()} - {owner}
                if RANKS[found["role"]] > RANKS[role] or found["owner"] in others:
                    rig.ledger.broke(RIGHTS, rig.name, f"{name} is {found['role']} of {found['owner']}", text, answer)
            rig.stopping.wait(0.3)
        rig.keys_file.write_bytes(rig.keys_text)
        rig.stopping.wait(1.5)


def webhooks_hang(rig, random):
    """Hosts of webhooks that accept and never answer, beside one that works."""
    rig.receivers.attack(rig, random)


FAULTS = {
    fault.__name__: fault
    for fault in (
        kill_service, kill_often, restart, kill_worker, stop_service, stop_worker, full_disk, data_moved,
        database_replaced, database_removed, blobs_moved, keys_cut, keys_flipped, webhooks_hang,
        flips.result_flipped, flips.export_flipped, flips.checkpoint_flipped, flips.files_removed,
        copies.copy_with_damaged_database, copies.copy_with_damaged_files,
    )
}
