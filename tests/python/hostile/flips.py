"""Stored files whose bytes change while the service runs: each change is found at the next read."""

import os
import re
import signal
import time

from .jobs import judge_bytes
from .ledger import OTHER
from .wire import LATER

NAME = re.compile(r"([0-9a-f]{8}-[0-9a-f-]{27})\.")


def flip(file, random, begin=0):
    """Flips a bit of a file from `begin` on; its length and time stay. Returns its place and what undoes it."""
    before = file.stat()
    place, bit = random.randrange(begin, before.st_size), 1 << random.randrange(8)
    byte = _exchange(file, place, lambda byte: byte ^ bit)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))

    def undo():
        # Not where the service has made the file again meanwhile.
        if file.stat().st_ino == before.st_ino:
            _exchange(file, place, lambda found: byte if found == byte ^ bit else found)

    return place, undo


def _exchange(file, place, change):
    """Writes another byte at this place; returns the one before."""
    with file.open("r+b") as out:
        out.seek(place)
        byte = out.read(1)[0]
        out.seek(place)
        out.write(bytes([change(byte)]))
    return byte


def remember_removed(rig, file):
    """A result that the fault itself removes, with its job by the name of the file."""
    found = NAME.match(file.name)
    if not found:
        return
    rig.removed.add(found.group(1))
    for job in list(rig.jobs.values()):
        if job.id == found.group(1):
            job.damage()


def _victim(rig, random, ending):
    """A finished job and one of its files, with the lock of nobody: its client goes on."""
    jobs = [job for job in list(rig.jobs.values()) if job.done and not (job.deleted or job.damaged or job.lost)]
    random.shuffle(jobs)
    for job in jobs:
        files = [
            file
            for file in rig.files_below(rig.artifacts())
            if file.name.startswith(f"{job.id}.") and file.name.endswith(ending)
        ]
        if ending == ".packstone" and job.done:
            files = [file for file in files if f"{job.id}.{job.done[0]}." in file.name]
        if files:
            return job, random.choice(files)
    return None, None


def result_flipped(rig, random):
    """A bit of a result flips, is reported at the next read, and flips back or is packed again."""
    job, file = _victim(rig, random, ".packstone")
    if job is None:
        return
    done = job.done
    job.damage()
    try:
        place, undo = flip(file, random)
    except OSError:
        job.heal()
        return
    paths = [f"/v1/jobs/{job.id}/result?format={form}" for form in ("npy", "csv", "json")]
    _read(rig, job, paths, "npy", place)
    rig.stopping.wait(random.uniform(0, 1))
    # Half of the clients find it and let it be packed again.
    if random.random() < 0.5 and job.done == done:
        _restore(rig, job, done, undo)


def _restore(rig, job, done, change):
    """Puts a file right, unless it was replaced by a new one meanwhile."""
    try:
        change()
    except OSError:
        return
    if job.done == done:
        job.heal()


def _read(rig, job, paths, what, place):
    """Reads the files of a damaged job: what comes is right, or an error, or cut."""
    name = "root" if rig.with_keys else None
    for path in paths:
        answer = rig.client(name).ask("GET", path, headers={"Prefer": "wait=5"})
        if answer is None or answer.status in LATER or answer.status in (202, 404, 409):
            continue
        request = f"GET {path} (a bit flipped at {place})"
        if answer.status == 410:
            rig.ledger.count("damaged files reported")
        elif answer.status == 200:
            judge_bytes(rig, job, path.partition("format=")[2] if "/result" in path else what, (0, 0), answer, request)
        elif answer.status != 500:
            rig.ledger.broke(OTHER, rig.name, f"a damaged file is answered with {answer.status}", request, answer)


def export_flipped(rig, random):
    """A bit of the file of an export flips; then the file is right, or made again, or reported."""
    job, file = _victim(rig, random, ".export")
    if job is None:
        return
    done = job.done
    job.damage()
    try:
        place, undo = flip(file, random)
    except OSError:
        job.heal()
        return
    # All of its exports are read: which one the file has is not told by its name.
    from .honest import EXPORTS

    for what in EXPORTS:
        _read(rig, job, [f"/v1/jobs/{job.id}/exports/{what}"], what, place)
    _restore(rig, job, done, undo)


def checkpoint_flipped(rig, random):
    """A bit of a checkpoint flips, and the service is killed: the job ends with the right packing all the same."""
    rig.spare_client.tidy()
    rig.spare_client.submit_kind("long")
    folder = rig.data / "checkpoints"
    end = time.monotonic() + 4
    while time.monotonic() < end and not rig.stopping.is_set():
        for file in list(folder.glob("*.checkpoint")):
            with rig.windows.open("kill"):
                # Stopped, it cannot write another one.
                rig.service.send_signal(signal.SIGSTOP)
                try:
                    flip(file, random)
                except (OSError, ValueError):
                    rig.service.send_signal(signal.SIGCONT)
                    continue
                rig.kill()
                rig.ledger.count("checkpoints damaged")
                rig.start_or_report("after SIGKILL, with a damaged checkpoint")
            return
        rig.stopping.wait(0.02)


def files_removed(rig, random):
    """The file of a result is removed, reported, and put back or packed again."""
    job, file = _victim(rig, random, ".packstone")
    if job is None:
        return
    done = job.done
    job.damage()
    kept = rig.disk / "removed"
    try:
        os.rename(file, kept)
    except OSError:
        job.heal()
        return
    paths = [f"/v1/jobs/{job.id}/result?format={form}" for form in ("npy", "csv")]
    _read(rig, job, paths, "npy", "removed")
    rig.stopping.wait(random.uniform(0, 1))
    if random.random() < 0.5 and job.done == done:
        _restore(rig, job, done, lambda: os.rename(kept, file))
    elif kept.exists():
        kept.unlink()
