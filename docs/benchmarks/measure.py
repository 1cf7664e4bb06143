"""Repeats our part of BENCHMARKS.md: python measure.py PACKSTONE [WORD]

Packs each case whose name contains WORD with one thread and seed 1, and prints the CPU seconds of the command, with its
check and its result, beside those of the table.
"""

import json
import resource
import subprocess
import sys
import tempfile

from cases import CASES


def main():
    program, word = sys.argv[1], "".join(sys.argv[2:3])
    print(f"{'case':36} {'now, s':>8} {'table, s':>8}")
    for name, ours, _, _, job in CASES:
        if word not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            ended = subprocess.run([program, "run", "-", "--out", folder, "--threads", "1"], text=True,
                                   input=json.dumps({"seed": 1, **job}), capture_output=True, check=False)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        failure = "" if ended.returncode == 0 else ended.stderr.strip().splitlines()[-1]
        print(f"{name:36} {seconds:8.2f} {ours:8.2f} {failure}", flush=True)


if __name__ == "__main__":
    main()
