"""The page with the options of every command, as the binary states them."""

import os
import re
import subprocess


def help_of(program: str, *command: str) -> str:
    """What `packstone COMMAND --help` prints."""
    # The help shows the values of the variables that are options.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PACKSTONE")}
    asked = subprocess.run([program, *command, "--help"], check=True, capture_output=True, text=True, env=environment)
    return asked.stdout.strip()


def command_page(program: str) -> str:
    """The page in Markdown."""
    overview = help_of(program)
    listed = overview.split("Commands:\n")[1].split("\n\n")[0]
    names = [name for name in re.findall(r"^  (\S+)", listed, re.MULTILINE) if name != "help"]
    parts = ["# Commands and options\n\nWhat `packstone COMMAND --help` prints.\n", f"```text\n{overview}\n```\n"]
    parts += [f"## packstone {name}\n\n```text\n{help_of(program, name)}\n```\n" for name in names]
    return "\n".join(parts)
