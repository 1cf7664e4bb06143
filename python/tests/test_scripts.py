"""The lab scripts, run as they are."""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

from live_server import REPOSITORY, LiveServer


def run(server: LiveServer, directory: Path, *command: str | Path) -> str:
    """Runs a script in a directory, with the server in its environment, and returns what it prints."""
    env = os.environ | {"PACKSTONE_URL": server.url, "MPLBACKEND": "agg"}
    ended = subprocess.run(
        command, cwd=directory, env=env, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_the_example_plots_success_rates(server: LiveServer, tmp_path: Path) -> None:
    example = REPOSITORY / "python/examples/success_rate.py"
    said = run(server, tmp_path, sys.executable, example)
    assert "140 of 140 jobs ended" in said
    assert re.search(r"^\d+ grains; the largest has ", said, re.MULTILINE)
    assert (tmp_path / "success_rate.png").read_bytes().startswith(b"\x89PNG")
    assert "</svg>" in (tmp_path / "success.svg").read_text() and "</svg>" in (tmp_path / "time.svg").read_text()
    assert (tmp_path / "densest.vtp").exists()
    saved = re.search(r"^(\d+) packings saved", said, re.MULTILINE)
    assert saved is not None and int(saved[1]) == len(list((tmp_path / "packings").glob("*.npy"))) > 70


def test_a_study_with_its_plot_and_a_reopened_packing_take_twenty_lines(server: LiveServer, tmp_path: Path) -> None:
    example = REPOSITORY / "python/examples/first_study.py"
    assert len([line for line in example.read_text().splitlines() if line]) <= 20
    said = run(server, tmp_path, sys.executable, example)
    assert re.search(r"^<Packing of \d+ grains: .*>, the largest grain has 1[0-6]\.\d\d mm$", said, re.MULTILINE)
    assert (tmp_path / "first_study.png").read_bytes().startswith(b"\x89PNG")


def test_the_script_for_the_shell(server: LiveServer, tmp_path: Path) -> None:
    (tmp_path / "files").mkdir()
    said = run(server, tmp_path, REPOSITORY / "clients/curl/study.sh", "files")
    assert re.search(r"^\d+ succeeded, \d+ failed, of 30$", said, re.MULTILINE)
    assert "phi 0.55  rsa\t5 of 5" in said
    with (tmp_path / "files/table.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 6 and all(row["runs"] == "5" for row in rows)
    packing = (tmp_path / "files/packing.csv").read_text().splitlines()
    grains = re.search(r"^(\d+) grains; the largest, of ([\d.]+) mm", said, re.MULTILINE)
    assert grains is not None and int(grains[1]) == len(packing) - 1
    assert packing[1].endswith(f",{grains[2]}")
    assert "</svg>" in (tmp_path / "files/success.svg").read_text()
    assert "</svg>" in (tmp_path / "files/slice.svg").read_text()
    succeeded = sum(int(row["successes"]) for row in rows)
    assert len(list((tmp_path / "files").glob("packing-*.csv"))) == succeeded


def test_the_script_for_the_shell_says_what_the_server_refused(server: LiveServer, tmp_path: Path) -> None:
    env = os.environ | {"PACKSTONE_URL": f"{server.url}/elsewhere"}
    ended = subprocess.run(
        [REPOSITORY / "clients/curl/study.sh"], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
    )
    assert ended.returncode != 0 and "not-found" in ended.stderr
