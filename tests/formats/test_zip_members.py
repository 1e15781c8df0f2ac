"""A zip archive may state any length for its list of members; nothing of that length is read."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from formats.zip_members import MOST_LIST, members_of
from tests.fit.here import hangtime_here


def hostile(path, hole):
    """An archive of arrays, then a hole of so many bytes, which takes no room; a ZIP64 record calls it the list.

    Source of the records: APPNOTE.TXT, 4.3.14 to 4.3.16.
    """
    packed = io.BytesIO()
    np.savez(packed, about=np.array("{}"))
    at = len(packed.getvalue())
    end = at + hole
    with path.open("wb") as file:
        file.write(packed.getvalue())
        file.seek(end)
        file.write(struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, 1, 1, hole, at))
        file.write(struct.pack("<4sLQL", b"PK\6\7", 0, end, 1))
        file.write(struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, 0xFFFFFFFF, 0xFFFFFFFF, 0))
    return path


@pytest.mark.parametrize("hole", [MOST_LIST + 1, 400_000_000, 300_000_000_000])
def test_a_list_that_is_longer_than_any_recordings_is_refused_before_it_is_read(tmp_path, hole):
    with hostile(tmp_path / "a.npz", hole).open("rb") as file:
        tracemalloc.start()
        with pytest.raises(zipfile.BadZipFile, match="its list of members has more than 8388608 bytes"):
            members_of(file)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert most < 1e7  # bytes; the list itself, of MOST_LIST, is the longest read


def test_the_members_of_a_sound_archive_are_listed(tmp_path):
    """60,000 arrays, as of half an hour of scans ten times a second, three arrays each."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for number in range(60_000):
            archive.writestr(f"scan{number // 3}_{('time', 'grid', 'contour')[number % 3]}.npy", b"")
    with (tmp_path / "a.zip").open("rb") as file:
        assert len(members_of(file)) == 60_000


def test_an_import_of_such_an_archive_ends_in_a_sentence(tmp_path):
    hostile(tmp_path / "a.npz", 300_000_000_000)
    done = hangtime_here("import", "a.npz", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("hangtime: a.npz: is an .npz archive that is damaged or holds objects; give ")
