"""Run commands as somebody whom the permissions of files hold for: root's do not."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.fit.here import Done
from tests.repository import ROOT

WITHOUT = ("setpriv", "--bounding-set", "-dac_override,-dac_read_search")
SCRIPT = """
import dataclasses, json, sys
from tests.fit.here import hangtime_here
folder, commands = json.loads(sys.argv[1])
print(json.dumps([dataclasses.astuple(hangtime_here(*words, folder=folder)) for words in commands]))
"""


def hangtime_unprivileged(*commands, folder):
    """Run commands, each given as its words, one after the other in one process; returns how each ended."""
    prefix = () if os.geteuid() else WITHOUT
    if prefix and shutil.which("setpriv") is None:
        pytest.skip("root without setpriv (util-linux) has every permission")
    words = [[str(word) for word in command] for command in commands]
    ran = subprocess.run(
        [*prefix, sys.executable, "-c", SCRIPT, json.dumps([str(folder), words])], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    return [Done(*ended) for ended in json.loads(ran.stdout)]
