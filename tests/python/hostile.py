"""Runs hostile clients and faults of the machine beside honest clients against real services, and counts what breaks.

    python3 hostile.py --binary target/release/packstone [--seconds 120] [--seed 1]

Two services on loopback, each with a data directory and a worker process of its own, are attacked in an order that the
seed determines: hostile clients, SIGKILL and SIGSTOP, full disks, moved, replaced and damaged stores, and flipped bits
in stored files. Honest clients submit, read, compare, cancel, retry and delete at the same time. At the end a table has
the counts; the exit code is 1 where an accepted job was lost or doubled, wrong bytes or an answer of 500 were sent, or
a service was not ready more than 5 s after a fault.

Needs Python 3.11 and nothing else. As root, each service has a small disk of its own (tmpfs), in namespaces that end
with the command; otherwise a limit of the length of files stands in for the full disk. `docs/operation.md`, "Tested
under faults", explains the table.
"""

import argparse
import ctypes
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

NAMESPACES = ["unshare", "--mount", "--propagation", "private", "--pid", "--fork", "--kill-child", "--mount-proc"]
# Beyond --seconds, for the start and for the accounting at the end.
MOST_EXTRA_S = 30


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", required=True, type=Path)
    parser.add_argument("--seconds", type=float, default=120, help="time of the attacks, at least 20")
    parser.add_argument("--seed", type=int, help="determines the order of events; drawn and printed by default")
    parser.add_argument("--only", default="", help="names of faults and attacks, with commas; all by default")
    parser.add_argument("--verbose", action="store_true", help="print each event when it begins")
    parser.add_argument("--keep", action="store_true", help="keep the folder with the data directories and logs")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.seconds < 20:
        parser.error("--seconds must be at least 20")
    binary = options.binary.resolve()
    if not os.access(binary, os.X_OK):
        parser.error(f"--binary {options.binary}: no program of that name")
    if options.folder:
        from hostile.run import run

        names = {name for name in options.only.split(",") if name}
        sys.exit(run(binary, options.folder, options.seconds, options.seed, names, options.verbose))
    sys.exit(supervise(options, binary))


def supervise(options, binary):
    """Runs the attacks in a process whose descendants end with it, and removes the files that they leave."""
    seed = random.SystemRandom().randrange(1 << 32) if options.seed is None else options.seed
    print(f"seed {seed}: repeat with --seed {seed} --seconds {options.seconds:g}", flush=True)
    folder = Path(tempfile.mkdtemp(prefix="packstone-hostile-"))
    command = [sys.executable, "-B", __file__, "--binary", binary, "--folder", folder, "--seed", str(seed)]
    command += ["--seconds", str(options.seconds), "--only", options.only]
    command += ["--verbose"] if options.verbose else []
    if has_namespaces():
        command = NAMESPACES + command
    inner = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, preexec_fn=end_with_parent)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(130))
    try:
        return inner.wait(timeout=options.seconds + MOST_EXTRA_S + 10)
    except subprocess.TimeoutExpired:
        print(f"the attacks did not end within {options.seconds + MOST_EXTRA_S + 10:g} s", file=sys.stderr)
        return 1
    finally:
        # The session has all processes where there are no namespaces.
        try:
            os.killpg(inner.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        inner.wait()
        if options.keep:
            print(f"kept: {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)


def end_with_parent():
    """Lets the kernel end this process with its parent, however that ends (PR_SET_PDEATHSIG)."""
    ctypes.CDLL(None, use_errno=True).prctl(1, signal.SIGKILL)


def has_namespaces():
    """Whether this user may make namespaces of mounts and processes."""
    if os.geteuid() != 0 or not shutil.which("unshare"):
        return False
    return subprocess.run([*NAMESPACES, "true"], capture_output=True, check=False).returncode == 0


if __name__ == "__main__":
    main()
