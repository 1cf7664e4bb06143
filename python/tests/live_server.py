"""The real server as a process of its own."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from pathlib import Path
from types import TracebackType

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


def binary() -> Path:
    """The program under test: that of `PACKSTONE_BINARY`, or the one that cargo built last."""
    named = os.environ.get("PACKSTONE_BINARY")
    if named:
        return Path(named).resolve(strict=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    built = [path for path in (target / "debug/packstone", target / "release/packstone") if path.exists()]
    if not built:
        pytest.exit(f"no packstone in {target}: build it, or name one by PACKSTONE_BINARY", returncode=1)
    return max(built, key=lambda path: path.stat().st_mtime)


class LiveServer:
    """A server with a data directory, on a free port of this machine unless one is named."""

    def __init__(self, directory: Path, *args: str, listen: str = "127.0.0.1:0") -> None:
        self._log = directory / "server.log"
        command = [str(binary()), "serve", "--listen", listen, "--data-dir", str(directory / "data"), *args]
        # The environment of whoever runs the suite must not change what is tested.
        env = {name: value for name, value in os.environ.items() if not name.startswith("PACKSTONE_")}
        with self._log.open("a") as log:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, text=True, env=env
            )
        assert self._process.stdout is not None
        # Its one line of output; the pipe closes when it ends without having listened.
        said = self._process.stdout.readline()
        self._process.stdout.close()
        found = re.search(r"http://([\d.]+:\d+)", said)
        if found is None:
            self.kill()
            pytest.fail(f"the server did not listen:\n{self._log.read_text()}")
        self.url, self.address = found.group(), found.group(1)

    def kill(self) -> None:
        """Ends it as a power cut would."""
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        """Ends it as an operator would, and fails if it has met a fault of its own."""
        self._process.send_signal(signal.SIGTERM)
        status = self._process.wait(timeout=60)
        faults = [line for line in self._log.read_text().splitlines() if re.search(r"\bERROR\b|panicked", line)]
        assert status == 0 and not faults, f"the server ended with {status}: {faults}"

    def __enter__(self) -> LiveServer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            # A test that failed has said why, and a server in whatever state would say less.
            self.stop() if kind is None else self.kill()
