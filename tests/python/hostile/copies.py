"""Copies of a store that are damaged: what a service on one serves is right, or an error that names the damage."""

import random as randoms
import shutil
import subprocess

from . import flips
from .jobs import judge_bytes
from .ledger import INTERNAL, OTHER, WRONG_BYTES
from .rig import environment, free_port
from .wire import LATER, Client

PAGE = 4096
# Fields of a job that do not depend on when it is asked for.
LASTING = ("id", "name", "labels", "state", "attempt", "max_attempts", "priority", "owner", "submitted_by", "seed",
           "created_at", "started_at", "finished_at", "error", "result", "warnings", "point", "replicate")


def copy_with_damaged_database(rig, random):
    """A backup in whose database a bit flips, or pages are zeros or those of another place."""
    _attack_copy(rig, random, _damage_database)


def copy_with_damaged_files(rig, random):
    """A backup in which bits of results and exports flip, and files are missing, cut or longer."""
    _attack_copy(rig, random, _damage_files)


def _damage_database(copy, random):
    """Damages the database; what was done."""
    file = copy / "data" / "packstone.sqlite"
    size = file.stat().st_size
    way = random.choice(["bit", "bit", "bit", "bits", "zeros", "page", "cut"])
    if way == "cut":
        with file.open("r+b") as out:
            out.truncate(random.randrange(PAGE, size))
    elif way in ("bit", "bits"):
        for _ in range(1 if way == "bit" else 20):
            flips.flip(file, random, 100 if random.random() < 0.9 else 0)
    else:
        pages = size // PAGE
        with file.open("r+b") as out:
            for _ in range(random.randrange(1, 4)):
                out.seek(PAGE * random.randrange(pages))
                other = out.read(PAGE)
                out.seek(PAGE * random.randrange(1, pages))
                out.write(other if way == "page" else bytes(PAGE))
    return f"database: {way}"


def _damage_files(copy, random):
    """Damages results and exports; what was done."""
    files = sorted(file for file in copy.rglob("*") if file.suffix in (".packstone", ".export"))
    done = []
    for file in random.sample(files, min(len(files), 12)):
        way = random.choice(["bit", "bit", "bit", "removed", "cut", "longer"])
        if way == "bit":
            flips.flip(file, random)
        elif way == "removed":
            file.unlink()
        elif way == "cut":
            with file.open("r+b") as out:
                out.truncate(random.randrange(file.stat().st_size))
        else:
            with file.open("ab") as out:
                out.write(b"\0" * random.choice([1, 64, 4096]))
        done.append(f"{file.name}: {way}")
    return "; ".join(done)


class _Side:
    """What a client needs of a rig."""

    def __init__(self, rig, port):
        self.rig, self.port, self.windows = rig, port, rig.windows

    def judge_status(self, honest, status, request, answer):
        """A copy must not answer 500 either."""
        self.rig.ledger.answered(honest, status)
        if status == 500:
            self.rig.ledger.broke(INTERNAL, self.rig.name, f"500 on a copy ({self.damage})", request, answer)

    def broke_other(self, what, request="", answer=""):
        """A promise that a copy breaks."""
        self.rig.broke_other(f"{what} on a copy ({self.damage})", request, answer)


def _attack_copy(rig, random, damage):
    """Makes a backup, damages it, and reads all of it through a service of its own."""
    seed = random.randrange(1 << 30)
    random = randoms.Random(seed)
    copy = rig.folder / "copy"
    command = [rig.binary, "backup", copy / "data", "--data-dir", rig.data]
    if rig.blobs:
        command += ["--blobs", rig.blobs]
    try:
        known, whole = _documents(rig), _whole_jobs(rig)
        # No other fault is injected at the same time: a backup is made while the service runs.
        ended = subprocess.run(command, capture_output=True, text=True, check=False, env=environment(), timeout=60)
        if ended.returncode != 0 and _names_damaged_files_alone(whole & _whole_jobs(rig), ended.stdout):
            rig.ledger.count("backups that named a damaged file")
            return
        if ended.returncode != 0:
            answer = (ended.stdout + ended.stderr)[-700:]
            rig.broke_other(f"packstone backup ended with {ended.returncode}", "", answer)
            return
        if rig.blobs:
            shutil.copytree(rig.blobs, copy / "blobs", ignore_dangling_symlinks=True)
        else:
            _unlink_from_store(copy)
        what = damage(copy, random)
        _read_copy(rig, random, copy, known, what)
    except (FileNotFoundError, shutil.Error):
        # A file was swept while it was copied.
        rig.ledger.count("copies that lacked a file which was swept meanwhile")
    finally:
        shutil.rmtree(copy, ignore_errors=True)


def _whole_jobs(rig):
    """The jobs whose files no fault has damaged, or that were packed again since."""
    return {job.id for job in list(rig.jobs.values()) if not (job.deleted or job.damaged)}


def _names_damaged_files_alone(whole, printed):
    """Whether a backup names files, and none of a job that was `whole` from its begin to its end."""
    named = [flips.NAME.search(line) for line in printed.splitlines() if ": " in line and "deleted while" not in line]
    return bool(named) and all(found and found.group(1) not in whole for found in named)


def _unlink_from_store(copy):
    """A backup may be hard links of the files of the store: the copy gets files of its own."""
    for file in copy.rglob("*"):
        if file.is_file() and file.stat().st_nlink > 1:
            own = file.with_name(file.name + ".own")
            shutil.copy2(file, own)
            own.replace(file)


def _documents(rig):
    """The documents of finished jobs, before the copy was made."""
    found = {}
    client = rig.client("root")
    for job in list(rig.jobs.values()):
        if job.done and not job.deleted and not job.damaged and len(found) < 40:
            answer = client.ask("GET", f"/v1/jobs/{job.id}")
            if answer and answer.status == 200 and answer.json()["state"] == "succeeded":
                found[job.id] = (job, answer.json())
    return found


def _read_copy(rig, random, copy, known, what):
    """Starts a service on the copy and holds what it says against what is known."""
    port = free_port()
    command = [rig.binary, "serve", "--data-dir", copy / "data", "--listen", f"127.0.0.1:{port}", "--workers", "0"]
    command += ["--sweep-interval-s", "60"]
    if rig.blobs:
        command += ["--blobs", copy / "blobs"]
    log = (copy / "log").open("wb")
    service = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, env=environment(), restore_signals=False
    )
    try:
        if b"http://" not in service.stdout.readline():
            said = (copy / "log").read_text(errors="replace")
            if service.wait(20) not in (1, 2, 3, 4, 5, 6) or "panicked" in said:
                rig.broke_other(f"a damaged copy ({what}) ends the start with {service.returncode}", "", said[-1500:])
            rig.ledger.count("damaged copies refused at the start")
            return
        side = _Side(rig, port)
        side.damage = what
        _judge_copy(rig, random, side, known)
        if service.poll() is not None:
            rig.broke_other(f"a damaged copy ({what}) ends the service with {service.returncode}", "",
                            (copy / "log").read_text(errors="replace")[-1500:])
        rig.ledger.count("damaged copies read")
    finally:
        service.kill()
        service.wait()
        log.close()


def _judge_copy(rig, random, side, known):
    """Reads lists, documents and results of the copy."""
    client = Client(side)
    for path in ("/v1/jobs?limit=100", "/v1/studies", "/metrics", "/readyz", "/healthz"):
        answer = client.ask("GET", path)
        if answer and answer.status == 200 and path.startswith("/v1/jobs"):
            for item in answer.json()["items"]:
                if item.get("id") in known:
                    _compare(rig, side, known[item["id"]][1], item, path)
    chosen = random.sample(sorted(known), min(len(known), 25))
    for identity in chosen:
        job, before = known[identity]
        answer = client.ask("GET", f"/v1/jobs/{identity}")
        if answer and answer.status == 200:
            _compare(rig, side, before, answer.json(), f"/v1/jobs/{identity}")
        for form in random.sample(["npy", "csv", "json", "view"], 2):
            path = f"/v1/jobs/{identity}/result?format={form}"
            answer = client.ask("GET", path)
            if answer and answer.status == 200:
                judge_bytes(rig, job, form, (0, 0), answer, f"GET {path} on a copy ({side.damage})")
            elif answer and answer.status not in LATER | {404, 409, 410, 500}:
                rig.ledger.broke(OTHER, rig.name, f"{answer.status} on a copy ({side.damage})", path, answer)


def _compare(rig, side, before, found, path):
    """The fields of a job that do not change."""
    for name in LASTING:
        if name in found and found[name] != before.get(name):
            text = f"{name} of {before['id']} was {before.get(name)} and is {found[name]} on a copy ({side.damage})"
            rig.ledger.broke(WRONG_BYTES, rig.name, text[:1500], f"GET {path}")
            return

