"""Faults of the machine and of the store, one after the other, and the moment when each is over."""

import os
import signal
import time

from . import copies, flips, liar, places
from .ledger import RIGHTS

# Ranks of roles: a damaged file of keys may take rights away, and never give any.
RANKS = {"metrics": 0, "worker": 0, "read": 1, "submit": 2, "admin": 3}


def run(rig, random, until, only):
    """Injects each fault once in an order that is drawn, and again."""
    names = [name for name in FAULTS if not only or name in only]
    names = [name for name in names if rig.with_keys or name not in KEYS]
    names = [name for name in names if not rig.with_keys or name not in ("webhooks_hang", "results_moved")]
    while names and not rig.stopping.is_set():
        random.shuffle(names)
        for name in names:
            if time.monotonic() > until - 6:
                return
            rig.stopping.wait(random.uniform(0.5, 2.0))
            rig.ledger.event(rig.name, name)
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


def keys_cut(rig, random):
    """The file of keys ends anywhere, as when it is being written."""
    _keys_are(rig, lambda file: file.write_bytes(rig.keys_text[: random.randrange(len(rig.keys_text))]))


def keys_flipped(rig, random):
    """A bit of the file of keys is another one, and its time and length stay the same."""
    _keys_are(rig, lambda file: flips.flip(file, random))


def keys_strange(rig, random):
    """In the place of the file of keys is none, or something that cannot be read, or that has no end."""
    way = random.choice(["removed", "folder", "pipe", "endless", "secret", "mode"])

    def change(file):
        file.unlink()
        if way == "folder":
            file.mkdir()
        elif way == "pipe":
            os.mkfifo(file)
        elif way == "endless":
            file.symlink_to("/dev/zero")
        elif way == "secret":
            file.write_bytes(b"\xff" * 100_000)
        elif way == "mode":
            file.write_bytes(b"")

    _keys_are(rig, change)
    places.is_served(rig, f"a file of keys that was {way}")


def _keys_are(rig, change):
    """Lets the file of keys be something else for a while: no key has more rights than its line said."""
    with rig.no_submissions(), rig.key_windows.open("keys"), rig.windows.open("keys"):
        change(rig.keys_file)
        end = time.monotonic() + 2.5
        while time.monotonic() < end and not rig.stopping.is_set():
            for name, (_, role, owner) in rig.keys.items():
                answer = rig.client(name, honest=False).ask("GET", "/v1/key", timeout=10)
                found = answer.json() if answer and answer.status == 200 else None
                if not found:
                    continue
                others = {other for _, _, other in rig.keys.values()} - {owner}
                if RANKS[found["role"]] > RANKS[role] or found["owner"] in others:
                    text = rig.keys_file.read_bytes() if rig.keys_file.is_file() else rig.keys_file
                    what = f"{name} is {found['role']} of {found['owner']}"
                    rig.ledger.broke(RIGHTS, rig.name, what, text, answer)
            rig.stopping.wait(0.3)
        whole = rig.folder / "keys.whole"
        whole.write_bytes(rig.keys_text)
        if rig.keys_file.is_dir():
            rig.keys_file.rmdir()
        whole.replace(rig.keys_file)
        rig.stopping.wait(2.5)


def webhooks_hang(rig, random):
    """Hosts of webhooks that accept and never answer, beside one that works."""
    rig.receivers.attack(rig, random)


KEYS = ("keys_cut", "keys_flipped", "keys_strange", "audit_log_hangs")
FAULTS = {
    fault.__name__: fault
    for fault in (
        kill_service, kill_often, restart, kill_worker, stop_service, stop_worker, keys_cut, keys_flipped,
        keys_strange, webhooks_hang, liar.worker_lies, places.full_disk, places.data_moved, places.database_replaced,
        places.database_removed, places.log_of_database_moved, places.database_locked, places.results_moved,
        places.second_service, places.audit_log_hangs, places.standard_error_fails, flips.result_flipped,
        flips.export_flipped, flips.checkpoint_flipped, flips.files_removed, copies.copy_with_damaged_database,
        copies.copy_with_damaged_files,
    )
}
