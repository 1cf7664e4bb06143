"""One service with its data directory, a worker process, keys, and what is known of it."""

import os
import re
import resource
import signal
import socket
import subprocess
import threading
import time
from contextlib import contextmanager
from pathlib import Path

from .ledger import ENDED, INTERNAL, LOST, NOT_READY, OTHER, Windows
from .wire import Client

# A disk of its own that holds all jobs which the clients keep, with room to spare.
DISK_BYTES = 96 << 20
# A service serves within this, whatever clients do.
ADDRESS_SPACE_KIB = 1 << 20
# A start, a stop or the end of a service that found its store replaced take no longer, on a busy machine either.
MOST_START_S = 60.0
MOST_STOP_S = 15.0
LONGEST_LOG_BYTES = 16 << 20
# The service reads the file of keys at most this long after it changed.
KEYS_READ_S = 4.0


class Rig:
    """A service under attack."""

    def __init__(self, name, binary, folder, ledger, with_keys):
        self.name, self.binary, self.ledger, self.with_keys = name, binary, ledger, with_keys
        self.folder = folder / name
        self.disk = self.folder / "disk"
        self.disk.mkdir(parents=True)
        self.has_disk = os.geteuid() == 0 and self._mount()
        self.data = self.disk / "data"
        # One service keeps results in its data directory, the other one elsewhere.
        self.blobs = None if with_keys else self.disk / "blobs"
        self.port = free_port()
        self.windows, self.key_windows = Windows(), Windows()
        self.lifecycle = threading.RLock()
        self.stopping = threading.Event()
        self.jobs, self.studies = {}, {}
        self.lock = threading.Lock()
        self.submitting = threading.Semaphore(64)
        self.service = self.worker = None
        self.keys = {}
        self.options = []
        self.is_dead, self.workers = False, 0
        # Jobs whose results a fault itself has removed.
        self.removed, self.results_were_away = set(), False
        if with_keys:
            self._make_keys()

    def _mount(self):
        command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", self.disk]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    def _make_keys(self):
        """A key for each role and owner, and the file with their lines."""
        lines = []
        for name, role, owner in (
            ("root", "admin", "root"), ("anna", "submit", "lab"), ("bert", "submit", "field"),
            ("carl", "read", "lab"), ("cluster", "worker", "cluster"), ("prometheus", "metrics", "prometheus"),
        ):
            command = [self.binary, "key", name, "--role", role, "--owner", owner]
            key, line = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")[:2]
            self.keys[name] = (key, role, owner)
            lines.append(line + "\n")
        self.keys_file = self.folder / "keys"
        self.keys_text = "".join(lines).encode()
        self.keys_file.write_bytes(self.keys_text)
        (self.folder / "worker.key").write_text(self.keys["cluster"][0])

    def artifacts(self):
        """The folder of results and exports."""
        return (self.blobs or self.data) / "artifacts"

    @staticmethod
    def files_below(folder):
        """The files of a folder and of those in it, while the service adds and removes some."""
        # A folder that has gone is passed over, where `Path.glob` raises.
        return [Path(place, name) for place, _, names in os.walk(folder) for name in names]

    def remove(self, client, identity):
        """Cancels and deletes a job that no honest client looks after."""
        client.ask("POST", f"/v1/jobs/{identity}/cancel")
        for _ in range(20):
            answer = client.ask("DELETE", f"/v1/jobs/{identity}")
            if self.stopping.is_set() or (answer and answer.status in (204, 404)):
                return
            self.stopping.wait(0.1)

    def client(self, name=None, source="127.0.0.1", honest=True):
        """A client with the key of that name, where there are keys."""
        return Client(self, self.keys[name][0] if name and self.with_keys else None, source, honest)

    # Processes.

    def start(self, more=(), log=None):
        """Starts the service and waits until it says that it listens; returns whether it does."""
        command = ["sh", "-c", 'ulimit -v "$0" && exec "$@"', str(ADDRESS_SPACE_KIB)]
        command += [self.binary, "serve", "--data-dir", self.data, "--listen", f"127.0.0.1:{self.port}"]
        command += ["--workers", "1", "--checkpoint-every-s", "0", "--sweep-interval-s", "1", "--lease-s", "5"]
        command += ["--export-cache-bytes", "4000000", *self.options, *more]
        if self.with_keys:
            command += ["--api-keys-file", self.keys_file, "--audit-log", self.folder / "audit"]
        else:
            command += ["--blobs", self.blobs]
        for name in ("serve.log", "worker.log", "audit"):
            self._shorten(self.folder / name)
        with open(self.folder / "serve.log", "ab") as own:
            self.service = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=own if log is None else log,
                env=environment(), restore_signals=False,
            )
        said = self._first_line(self.service)
        if said is None:
            self.service.kill()
            self.service.wait()
            return False
        self.follow_memory()
        return True

    def _shorten(self, file):
        """Keeps a log of an hour from filling the disk of this machine."""
        if file.is_file() and file.stat().st_size > LONGEST_LOG_BYTES:
            file.replace(file.with_name(file.name + ".1"))

    def _first_line(self, process):
        """The line of the service's standard output, which is then left to itself."""
        found = []
        reader = threading.Thread(target=lambda: found.append(process.stdout.readline()), daemon=True)
        reader.start()
        reader.join(MOST_START_S)
        if not found or b"http://" not in found[0]:
            return None
        return found[0]

    def start_or_report(self, why, log=None):
        """Starts the service; that it refuses is a fault. It is then forced to go on, so that what is lost is found."""
        if self.start(log=log):
            return True
        self.broke_other(f"the service does not start ({why})", answer=self.last_log())
        if self.start(["--adopt-orphans"]):
            return True
        self.is_dead = True
        accepted = [job for job in list(self.jobs.values()) if job.id and not job.deleted and not job.lost]
        what = f"{len(accepted)} jobs: the service cannot be started again"
        self.ledger.broke(LOST, self.name, what, answer=self.last_log(), number=max(1, len(accepted)))
        self.stopping.set()
        return False

    def start_worker(self, port=None):
        """Starts a worker process, under a new name, of the service or of a proxy before it."""
        self.workers += 1
        command = [self.binary, "worker", "--server", f"http://127.0.0.1:{port or self.port}", "--slots", "1"]
        command += ["--name", f"{self.name}-worker-{self.workers}", "--scratch", self.folder / "worker"]
        command += ["--checkpoint-every-s", "0", "--send-checkpoints-every-s", "0.5"]
        if self.with_keys:
            command += ["--key-file", self.folder / "worker.key"]
        with open(self.folder / "worker.log", "ab") as log:
            self.worker = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, env=environment(),
                restore_signals=False,
            )

    def kill(self):
        """Ends the service as a power cut of its machine does."""
        self.follow_memory()
        self.service.kill()
        self.service.wait()
        self.ledger.count("services killed")

    def stop(self):
        """Asks the service to end; it does so in order."""
        self.follow_memory()
        self.service.send_signal(signal.SIGTERM)
        try:
            code = self.service.wait(MOST_STOP_S)
        except subprocess.TimeoutExpired:
            self.service.kill()
            code = f"nothing within {MOST_STOP_S:g} s"
            self.service.wait()
        if code != 0:
            self.broke_other(f"SIGTERM: the service ended with {code}", answer=self.last_log())

    def kill_all(self):
        """Ends all processes."""
        for process in (self.worker, self.service):
            if process and process.poll() is None:
                process.kill()
                process.wait()

    def last_log(self):
        """The end of the log."""
        path = self.folder / "serve.log"
        with path.open("rb") as log:
            log.seek(max(0, path.stat().st_size - 1500))
            return log.read().decode(errors="replace")[-600:]

    def follow_memory(self):
        """Notes the most memory that the service has had."""
        try:
            status = open(f"/proc/{self.service.pid}/status").read()
            found = re.search(r"VmHWM:\s+(\d+)", status)
            self.ledger.peak(f"most memory of the service '{self.name}', MiB", int(found.group(1)) >> 10)
        except (OSError, AttributeError):
            pass

    def limit_files(self, length):
        """Lets the service write no file longer than this, or as long as it likes."""
        try:
            _, hard = resource.prlimit(self.service.pid, resource.RLIMIT_FSIZE)
            soft = hard if length is None else length
            resource.prlimit(self.service.pid, resource.RLIMIT_FSIZE, (soft, hard))
        except ProcessLookupError:
            pass

    # Watching.

    def watch(self):
        """Restarts what ended, until the end of the attacks."""
        while not self.stopping.wait(0.1):
            if not self.lifecycle.acquire(blocking=False):
                continue
            try:
                if self.stopping.is_set():
                    return
                if self.service.poll() is not None:
                    code = self.service.returncode
                    self.ledger.broke(ENDED, self.name, f"the service ended with {code}", answer=self.last_log())
                    with self.windows.open("ended"):
                        self.start_or_report("after it ended")
                if self.worker.poll() is not None:
                    self.ledger.count("workers that ended by themselves")
                    self.start_worker()
            finally:
                self.lifecycle.release()

    def probe(self):
        """Asks for readiness all the time."""
        client = self.client(honest=False)
        last = time.monotonic()
        while not self.stopping.is_set():
            began = time.monotonic()
            answer = client.ask("GET", "/readyz", timeout=20)
            ended = time.monotonic()
            if self.stopping.is_set():
                return
            if answer is None or answer.status != 200:
                seconds = ended - last
                self.ledger.count("seconds not ready, in all", seconds)
                if not self.windows.allows(began, ended):
                    self.ledger.broke(NOT_READY, self.name, "not ready", "GET /readyz", answer or "none", seconds)
            last = ended
            self.stopping.wait(0.1)

    def judge_status(self, honest, status, request, answer):
        """No client may get a 5xx but those of a busy or faulty machine."""
        self.ledger.answered(honest, status)
        if status == 500:
            self.ledger.broke(INTERNAL, self.name, "an answer of 500", request, answer)
        elif status > 500 and status not in (503, 507):
            self.broke_other(f"an answer of {status}", request, answer)
        elif status in (503, 507) and honest and "retry-after" not in answer.headers:
            self.broke_other(f"an answer of {status} without Retry-After", request, answer)

    def broke_other(self, what, request="", answer=""):
        """A promise without a count of its own."""
        self.ledger.broke(OTHER, self.name, what, request, answer)

    def guarded(self, loop):
        """Runs a loop of these tests; a defect of them is a fault of the run: nothing may end quietly."""
        try:
            loop()
        except Exception as error:
            self.broke_other(f"a defect of the test program: {error!r}")
            raise

    # Keys.

    @contextmanager
    def submitting_one(self):
        """A submission; none begins while the file of keys is at fault, for its owner might be another one."""
        with self.submitting:
            yield

    @contextmanager
    def no_submissions(self):
        """Waits for the submissions on their way, and holds up others."""
        for _ in range(64):
            self.submitting.acquire()
        try:
            yield
        finally:
            for _ in range(64):
                self.submitting.release()

    def has_key_trouble(self, began):
        """Whether the file of keys was at fault since then, or so shortly before that it may not be read again."""
        return self.key_windows.allows(began, time.monotonic(), KEYS_READ_S)


def environment():
    """The environment without settings of packstone."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PACKSTONE_", "RUST_"))}


def free_port():
    """A port that the system gives nobody who asks for any: the service is started on it again and again."""
    begin = int(time.time() * 1000) % 9000
    for offset in range(9000):
        port = 20_000 + (begin + offset * 7) % 9000
        with socket.socket() as trial:
            try:
                trial.bind(("127.0.0.1", port))
                return port
            except OSError:
                continue
    raise SystemExit("no free port from 20000 to 28999")
