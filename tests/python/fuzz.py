"""Sends generated requests to the real server and holds every answer against its own OpenAPI document.

    python fuzz.py --binary target/release/packstone [--examples 500] [--least-cases 5000] [--seed 1]

Starts the server on a free port with a fresh data directory, gives it a few jobs so that a part of the requests meets real
ones, runs schemathesis, ends the server, and fails when a check failed, fewer cases than asked for were generated, the
server logged a fault, or it did not end in good order.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from pathlib import Path

SCHEMATHESIS = Path(sys.executable).with_name("schemathesis")

CONFIG = """
seed = {seed}
continue-on-failure = true
# An event stream of a job that does not end has no end of its own.
max-stream-events = 3
request-timeout = 60

[generation]
max-examples = {examples}
# A case that fails is reported as it is: shrinking costs minutes and CI keeps the seed.
no-shrink = true
database = "none"

[dictionaries.ids]
values = {ids}

# Without real ids nearly every answer would be 404.
[parameters]
"path.id" = {{ dictionary = "ids", probability = 0.7 }}

[checks]
enabled = false
not_a_server_error.enabled = true
status_code_conformance.enabled = true
content_type_conformance.enabled = true
response_headers_conformance.enabled = true
response_schema_conformance.enabled = true
negative_data_rejection.enabled = true
unsupported_method.enabled = true
allow_header_conformance.enabled = true
"""

SMALL = {
    "seed": 1,
    "specimen": {"type": "box", "size_mm": [30, 30, 30]},
    "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.3},
}

# Equal spheres added at random jam near 0.384: to find that out takes this one a minute.
LONG = {
    "seed": 1,
    "specimen": {"type": "box", "size_mm": [100, 100, 100], "boundary": "periodic"},
    "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1.0}, "volume_fraction": 0.39},
    "timeout_s": 3600,
}


STUDY = {
    "template": {key: value for key, value in SMALL.items() if key != "seed"},
    "grid": {"/mix/volume_fraction": {"from": 0.2, "to": 0.3, "step": 0.05}},
    "replicates": 2,
}


def start(binary, data_dir, log):
    """Starts the server and returns it with its base URL, as soon as it says where it listens."""
    command = [binary, "serve", "--listen", "127.0.0.1:0", "--data-dir", data_dir, "--workers", "1"]
    # Generated mixes may be large; what is fuzzed is the interface, not the engine's patience.
    command += ["--max-grains", "1000000", "--max-model-mib", "16"]
    server = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, text=True)
    # Its one line of output; the pipe closes when it ends without having listened.
    found = re.search(r"http://[\d.]+:\d+", server.stdout.readline())
    if not found:
        server.kill()
        sys.exit(f"the server did not listen:\n{Path(log.name).read_text()}")
    return server, found.group()


def submit(base, job, resource="jobs"):
    """Submits a job or a study, waits for it a little, and returns its id."""
    request = urllib.request.Request(
        f"{base}/v1/{resource}", json.dumps(job).encode(), {"content-type": "application/json", "prefer": "wait=2"}
    )
    with urllib.request.urlopen(request, timeout=60) as answer:
        return json.load(answer)["id"]


def export(base, job, address):
    """Starts an export of a job's result."""
    request = urllib.request.Request(f"{base}/v1/jobs/{job}/exports/{address}", method="POST")
    with urllib.request.urlopen(request, timeout=60) as answer:
        json.load(answer)


def cases_of(output):
    """The number of test cases in schemathesis' summary."""
    found = re.search(r"Test cases:\s*\n?\s*([\d,]+) generated", output)
    return int(found.group(1).replace(",", "")) if found else 0


def faults_in(log):
    """Lines of the server's log that tell of a fault of its own."""
    return [line for line in log.splitlines() if re.search(r"\bERROR\b|panicked", line)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", required=True)
    parser.add_argument("--examples", type=int, default=500, help="cases per operation and phase, at most")
    parser.add_argument("--least-cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--phases", default="examples,coverage,fuzzing,stateful")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as directory:
        log_path = Path(directory, "server.log")
        with log_path.open("w") as log:
            server, base = start(options.binary, str(Path(directory, "data")), log)
            try:
                # More finished jobs than one, since generated requests delete and cancel.
                ids = [submit(base, SMALL | {"seed": seed}) for seed in range(20)]
                for job in ids[:10]:
                    export(base, job, "voxels?format=raw&cells=8")
                    export(base, job, "slice")
                ids += [submit(base, STUDY | {"seed": seed}, "studies") for seed in range(10)]
                ids += [submit(base, LONG) for _ in range(3)]
                config = Path(directory, "schemathesis.toml")
                config.write_text(CONFIG.format(seed=options.seed, examples=options.examples, ids=json.dumps(ids)))
                command = [SCHEMATHESIS, "--config-file", config, "run", f"{base}/openapi.json"]
                command += ["--phases", options.phases, "--no-color"]
                # The stream of all changes lasts for an hour, and while one request waits for it nothing changes.
                # tests/change_stream.rs asks for it.
                command += ["--exclude-operation-id", "get_events"]
                run = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, cwd=directory)
                print(run.stdout, flush=True)
                with urllib.request.urlopen(f"{base}/readyz", timeout=10):
                    pass
            except urllib.error.URLError as error:
                sys.exit(f"the server does not answer: {error}\n{log_path.read_text()[-4000:]}")
            finally:
                server.send_signal(signal.SIGTERM)
                try:
                    status = server.wait(timeout=15)
                except subprocess.TimeoutExpired:
                    server.kill()
                    status = "killed: it did not end within 15 s"
        log = log_path.read_text()

    problems = []
    if run.returncode != 0:
        problems.append(f"schemathesis ended with {run.returncode}")
    if status != 0:
        problems.append(f"the server ended with {status}")
    if cases_of(run.stdout) < options.least_cases:
        problems.append(f"only {cases_of(run.stdout)} of {options.least_cases} cases were generated")
    problems += faults_in(log)[:20]
    if problems:
        sys.exit("\n".join(problems))
    print(f"{cases_of(run.stdout)} cases, no fault")


if __name__ == "__main__":
    main()
