"""Sends generated requests to the real server and holds every answer against its own OpenAPI document.

    python fuzz.py --binary target/release/packstone [--examples 40] [--least-cases 5000] [--share 1] [--seed 1]

Starts the server on a free port with a fresh data directory and a worker process, gives it a few jobs so that a part of
the requests meets real ones, stops the worker amid a job, so that jobs wait and one runs, and runs schemathesis. Then
another worker packs for a while what was accepted. Fails when a check failed, fewer cases than requested were
generated, server or workers logged a fault, or the server did not end in good order.

Of the 40 000 cases that the schema defines (the phase `coverage`), 38 000 are mistakes in the body of a job, the same
12 700 for a job, a plan and a study. `--share` of those are sent as jobs, a quarter of that as plans and as studies (4
sends all); the seed chooses which. All other cases are sent in any case.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

SCHEMATHESIS = Path(sys.executable).with_name("schemathesis")

CONFIG = """
seed = {seed}
hooks = {hooks}
continue-on-failure = true
request-timeout = 60

[generation]
max-examples = {examples}
# A case that fails is reported as it is: shrinking costs minutes and CI keeps the seed.
no-shrink = true
database = "none"

# Most operations have few values to choose from.
[[operations]]
include-operation-id = ["submit_job", "plan_job", "submit_study"]
generation.max-examples = {examples_of_bodies}

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

# Chooses by the content of the request, so that a share is the same whatever the order.
HOOKS = """
import json
import zlib

import schemathesis
from schemathesis.core.parameters import ParameterLocation

SHARES = {{"/v1/jobs": {share}, "/v1/plans": {share} / 4, "/v1/studies": {share} / 4}}


@schemathesis.hook
def filter_case(context, case):
    phase = case.meta and case.meta.phase
    if not phase or phase.name != "coverage" or phase.data.parameter_location != ParameterLocation.BODY:
        return True
    text = json.dumps([{seed}, case.path, case.body], default=str)
    return zlib.crc32(text.encode()) < SHARES.get(case.operation.path, 1) * 2**32
"""

SMALL = {
    "seed": 1,
    "specimen": {"type": "box", "size_mm": [30, 30, 30]},
    "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.3},
}

# Equal spheres added at random jam near 0.384: to find that out takes this one a minute. It starts after all others.
LONG = {
    "seed": 1,
    "priority": -100,
    "specimen": {"type": "box", "size_mm": [100, 100, 100], "boundary": "periodic"},
    "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1.0}, "volume_fraction": 0.39},
    "timeout_s": 3600,
}


# Time in which jobs are packed that were generated and accepted.
PACKING_S = 15

STUDY = {
    "template": {key: value for key, value in SMALL.items() if key != "seed"},
    "grid": {"/mix/volume_fraction": {"from": 0.2, "to": 0.3, "step": 0.05}},
    "replicates": 2,
}


def start(binary, data_dir, log):
    """Starts the server and returns it with its base URL, as soon as it says where it listens."""
    command = [binary, "serve", "--listen", "127.0.0.1:0", "--data-dir", data_dir, "--workers", "0"]
    # The worker that is stopped keeps its job.
    command += ["--lease-s", "3600"]
    # Generated mixes may be large; what is fuzzed is the interface, not the engine's patience.
    command += ["--max-grains", "1000000", "--max-model-mib", "16"]
    server = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, text=True)
    # Its one line of output; the pipe closes when it ends without having listened.
    found = re.search(r"http://[\d.]+:\d+", server.stdout.readline())
    if not found:
        server.kill()
        sys.exit(f"the server did not listen:\n{Path(log.name).read_text()}")
    return server, found.group()


def start_worker(binary, base, log):
    """Starts a process that packs the jobs of the server, one at a time."""
    command = [binary, "worker", "--server", base, "--slots", "1"]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=log)


def submit(base, job, resource="jobs", wait_s=60):
    """Submits a job or a study, waits for its end, and returns its id."""
    headers = {"content-type": "application/json", "prefer": f"wait={wait_s}"}
    request = urllib.request.Request(f"{base}/v1/{resource}", json.dumps(job).encode(), headers)
    with urllib.request.urlopen(request, timeout=90) as answer:
        return json.load(answer)["id"]


def await_start(base, job):
    """Waits until a job runs."""
    while True:
        with urllib.request.urlopen(f"{base}/v1/jobs/{job}", timeout=60) as answer:
            state = json.load(answer)["state"]
        if state == "running":
            return
        if state != "queued":
            sys.exit(f"the long job is {state}")
        time.sleep(0.1)


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
    """Lines of the logs of server and workers that tell of a fault of their own."""
    return [line for line in log.splitlines() if re.search(r"\bERROR\b|panicked", line)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", required=True)
    parser.add_argument("--examples", type=int, default=40, help="most cases of an operation to fuzz; 5 times for jobs")
    parser.add_argument("--share", type=float, default=1, help="share of the mistakes in the body of a job to be sent")
    parser.add_argument("--least-cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--phases", default="examples,coverage,fuzzing,stateful")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as directory:
        log_path = Path(directory, "server.log")
        with log_path.open("w") as log:
            server, base = start(options.binary, str(Path(directory, "data")), log)
            worker = start_worker(options.binary, base, log)
            try:
                # More finished jobs than one, since generated requests delete and cancel.
                ids = [submit(base, SMALL | {"seed": seed}) for seed in range(20)]
                for job in ids[:10]:
                    export(base, job, "voxels?format=raw&cells=8")
                    export(base, job, "slice")
                ids += [submit(base, STUDY | {"seed": seed}, "studies") for seed in range(10)]
                ids += [submit(base, LONG, wait_s=0) for _ in range(3)]
                await_start(base, ids[-3])
                worker.send_signal(signal.SIGSTOP)
                config = Path(directory, "schemathesis.toml")
                hooks = Path(directory, "hooks.py")
                hooks.write_text(HOOKS.format(seed=options.seed, share=options.share))
                config.write_text(
                    CONFIG.format(
                        seed=options.seed,
                        hooks=json.dumps(str(hooks)),
                        examples=options.examples,
                        examples_of_bodies=5 * options.examples,
                        ids=json.dumps(ids),
                    )
                )
                command = [SCHEMATHESIS, "--config-file", config, "run", f"{base}/openapi.json"]
                command += ["--phases", options.phases, "--no-color"]
                # Streams of events last as long as their job, or an hour, and are silent while nothing changes: each takes
                # the whole time limit of a request. tests/events.rs and tests/change_stream.rs request them.
                command += ["--exclude-operation-id", "get_events", "--exclude-operation-id", "get_job_events"]
                run = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, cwd=directory)
                print(run.stdout, flush=True)
                worker.kill()
                worker.wait()
                worker = start_worker(options.binary, base, log)
                time.sleep(PACKING_S)
                with urllib.request.urlopen(f"{base}/readyz", timeout=10):
                    pass
            except urllib.error.URLError as error:
                sys.exit(f"the server does not answer: {error}\n{log_path.read_text()[-4000:]}")
            finally:
                worker.kill()
                worker.wait()
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
