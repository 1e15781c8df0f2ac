"""Files of another kind as the appliance's configuration, and unknown keys: the error names the line."""

from __future__ import annotations

import pytest

from firmware_host.synthetic.scene import RIG
from formats.descriptions import dump_description
from tests.fit.here import hangtime_here

KNOWN = '[sensor]\nrig = "rig.toml"\n\n[spool]\nfolder = "spool"\n\n[sync]\nurl = "there"\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (dump_description(RIG), "c.toml, line 1: is no configuration of an appliance: unknown field `format`; the file "
         "states format hangtime-rig/1; give the appliance's configuration"),
        ('[project]\nname = "x"\n', "c.toml, line 1: is no configuration of an appliance: unknown field `project`"),
        (KNOWN + "[spool.old]\nx = 1\n", "c.toml, line 9: unknown field `old` in spool"),
        (KNOWN.replace("folder", "# the disk\nfolderr"), "c.toml, line 6: unknown field `folderr` in spool"),
        (KNOWN.replace('"spool"', "3"), "c.toml, line 5: spool.folder: a path must be a text that is not empty"),
        (KNOWN.replace("rig =", "rigg ="), "c.toml, line 2: unknown field `rigg` in sensor"),
        (KNOWN.replace("url", "urll"), "c.toml, line 8: [sync] is invalid: unknown field `urll`"),
        ("spool = 3\n", "c.toml, line 1: spool must be a table"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", ["takes prune --spool spool", "sync status"])
def test_no_take_is_pruned_and_nothing_is_said_by_a_file_that_is_no_configuration(tmp_path, command, text, says):
    (tmp_path / "spool").mkdir()
    (tmp_path / "c.toml").write_text(text)
    done = hangtime_here(*command.split(), "--config", "c.toml", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"hangtime: {says}"), done.stderr


def test_a_configuration_of_two_tables_is_enough_to_prune(tmp_path):
    (tmp_path / "spool").mkdir()
    (tmp_path / "c.toml").write_text('[spool]\nfolder = "spool"\n\n[sync]\nurl = "there"\n')
    done = hangtime_here("takes", "prune", "--config", "c.toml", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
