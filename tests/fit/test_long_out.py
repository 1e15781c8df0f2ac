"""A folder for --out whose name is too long is refused by one sentence, whichever command writes there."""

from __future__ import annotations

import pytest

from formats.archive import write_take
from tests.fit.batch.test_night_of_diagnoses import a_take
from tests.fit.here import hangtime_here

LONG = 300 * "x"  # bytes; the file systems of Linux allow 255


@pytest.mark.parametrize("out", [LONG, f"{LONG}/results", f"results/{LONG}"])
@pytest.mark.parametrize(
    "words",
    [
        "fit a.mcap", "diagnose a.mcap", "batch takes", "import a.npz", "takes export a.mcap --to csv",
        "takes recover a.mcap",
    ],
)  # fmt: skip
def test_a_name_that_is_too_long_for_a_folder_is_refused_in_the_same_words(tmp_path, words, out):
    (tmp_path / "takes").mkdir()
    write_take(tmp_path / "a.mcap", a_take("a"))
    write_take(tmp_path / "takes/a.mcap", a_take("a"))
    assert hangtime_here("takes", "export", "a.mcap", "--to", "npz", "--out", ".", folder=tmp_path).returncode == 0
    before = sorted(tmp_path.rglob("*"))
    done = hangtime_here(*words.split(), "--out", out, folder=tmp_path)
    where = f"{tmp_path}/{out}" if words.startswith("batch") else out
    assert (done.returncode, done.stdout) == (2, "")
    sentence = (
        ": cannot be made or written to (File name too long); choose a shorter name: the system allows no longer one"
    )
    assert done.stderr.splitlines()[-1].endswith(sentence)
    assert sorted(tmp_path.rglob("*")) == before
    assert where[-20:] in done.stderr
