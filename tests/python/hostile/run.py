"""The whole run: rigs, honest clients, faults and attacks in the order of the seed, and the accounting."""

import random
import resource
import threading
import time

from . import accounting, attacks, faults, honest
from .bodies import References
from .ledger import ENDED, OTHER, Ledger
from .rig import Rig
from .webhooks import Receivers

HONEST_CLIENTS = 3


def run(binary, folder, seconds, seed, only, is_verbose):
    """Attacks for so many seconds; the exit code."""
    _, most_files = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most_files, most_files))
    ledger = Ledger(seed, is_verbose)
    references = References(binary, folder / "references")
    making = threading.Thread(target=references.make, daemon=True)
    making.start()
    receivers = Receivers()
    rigs = [Rig("keys", binary, folder, ledger, True), Rig("open", binary, folder, ledger, False)]
    try:
        for rig in rigs:
            rig.references, rig.pure, rig.receivers = references, {}, receivers
            rig.options = receivers.options(binary, rig.folder)
            if not rig.start():
                ledger.broke(ENDED, rig.name, "no start", "", rig.last_log())
                return 1
            rig.start_worker()
        ledger.say(f"attacks for {seconds:g} s; small disks: {all(rig.has_disk for rig in rigs)}")
        until = time.monotonic() + seconds
        clients, threads = {}, {}
        for rig in rigs:
            started = honest.start(rig, seed, HONEST_CLIENTS)
            clients[rig.name], threads[rig.name] = started
            loops = [rig.watch, rig.probe]
            loops.append(lambda rig=rig: faults.run(rig, random.Random(f"{seed} faults {rig.name}"), until, only))
            loops.append(lambda rig=rig: attacks.run(rig, random.Random(f"{seed} attacks {rig.name}"), until, only))
            for loop in loops:
                thread = threading.Thread(target=rig.guarded, args=(loop,), daemon=True)
                thread.start()
                threads[rig.name].append(thread)
        time.sleep(max(0.0, until - time.monotonic()))
        accounting.finish(rigs, clients, threads)
        if references.fault:
            ledger.broke(OTHER, "references", references.fault)
    finally:
        for rig in rigs:
            rig.kill_all()
        ledger.table(seconds)
    return 1 if ledger.failed() else 0

