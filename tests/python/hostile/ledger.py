"""What happened, counted: events, requests, and every promise that was broken, with its request and answer."""

import collections
import threading
import time
from contextlib import contextmanager

# The service is ready again this long after an injected fault of its store at the latest.
READY_AFTER_S = 5.0
# Characters of a request or an answer that are printed.
SHOWN = 700

# Names of the counts that must be 0, in the order of the table.
LOST = "accepted jobs lost"
DOUBLED = "accepted jobs doubled"
WRONG_BYTES = "wrong bytes served"
INTERNAL = "answers of 500"
NOT_READY = "seconds not ready, beyond 5 s after a fault"
ENDED = "services that ended without a fault of their store"
RIGHTS = "rights that a key or a page does not have"
OTHER = "other broken promises"
MUST_BE_ZERO = [LOST, DOUBLED, WRONG_BYTES, INTERNAL, NOT_READY, ENDED, RIGHTS, OTHER]


class Ledger:
    """The counts of all services. Every method may be called from any thread."""

    def __init__(self, seed, is_verbose):
        self.seed, self.is_verbose = seed, is_verbose
        self.began = time.monotonic()
        self.lock = threading.Lock()
        self.broken = collections.Counter()
        self.first = {}
        self.events = collections.Counter()
        self.figures = collections.Counter()
        self.answers = collections.Counter()

    def now(self):
        """Seconds since the start."""
        return time.monotonic() - self.began

    def say(self, text):
        """Prints a line with the time."""
        print(f"{self.now():7.2f} {text}", flush=True)

    def event(self, rig, kind):
        """Counts a fault or an attack."""
        with self.lock:
            self.events[kind] += 1
        if self.is_verbose:
            self.say(f"{rig}: {kind}")

    def count(self, figure, number=1):
        """Adds to a figure of the table."""
        with self.lock:
            self.figures[figure] += number

    def peak(self, figure, value):
        """Notes the largest value of a figure."""
        with self.lock:
            self.figures[figure] = max(self.figures[figure], value)

    def answered(self, honest, status):
        """Counts an answer by its status."""
        with self.lock:
            self.answers["honest" if honest else "hostile", status] += 1

    def broke(self, promise, rig, what, request="", answer="", number=1):
        """Counts a broken promise; the first of each kind is printed at once, with its request and answer."""
        with self.lock:
            self.broken[promise] += number
            shown = self.first.setdefault(promise, [])
            if len(shown) >= 3:
                return
            shown.append(what)
        self.say(f"{rig}: BROKEN ({promise}): {what}")
        for name, text in (("request", request), ("answer", answer)):
            if text:
                print(f"  {name}: {str(text)[:SHOWN]}", flush=True)

    def failed(self):
        """Whether a count is above 0 that must be 0."""
        return any(self.broken[name] for name in MUST_BE_ZERO)

    def table(self, seconds):
        """Prints all counts."""
        print(f"\nseed {self.seed}, {seconds:.0f} s")
        for name in MUST_BE_ZERO:
            value = self.broken[name]
            print(f"{name:<52}{value:>10.1f}" if isinstance(value, float) else f"{name:<52}{value:>10}")
        for name, value in sorted(self.figures.items()):
            print(f"{name:<52}{value:>10.1f}" if isinstance(value, float) else f"{name:<52}{value:>10}")
        for who in ("honest", "hostile"):
            total = sum(number for (name, _), number in self.answers.items() if name == who)
            by_status = sorted((status, number) for (name, status), number in self.answers.items() if name == who)
            print(f"{'answers to ' + who + ' clients':<52}{total:>10}")
            print("    " + ", ".join(f"{status}: {number}" for status, number in by_status))
        print(f"{'events':<52}{sum(self.events.values()):>10}")
        print("    " + ", ".join(f"{kind}: {number}" for kind, number in sorted(self.events.items())))


class Windows:
    """When faults of a store were injected: only then, and a little later, the service may not be ready."""

    def __init__(self):
        self.lock = threading.Lock()
        self.spans = []

    @contextmanager
    def open(self, kind):
        """A fault that lasts as long as the block."""
        span = [time.monotonic(), None, kind]
        with self.lock:
            self.spans.append(span)
        try:
            yield
        finally:
            span[1] = time.monotonic()

    def allows(self, begin, end, after=READY_AFTER_S):
        """Whether a fault, or the time after one, overlaps this interval."""
        with self.lock:
            spans = list(self.spans)
        return any(start <= end and (stop is None or begin <= stop + after) for start, stop, _ in spans)

    def lasts(self, *kinds):
        """Whether a fault of one of these kinds lasts now, or of any kind."""
        with self.lock:
            return any(stop is None and (not kinds or kind in kinds) for _, stop, kind in self.spans)
