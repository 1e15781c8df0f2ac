"""What is no recording says what it is: downloads that failed, archives, workbooks, and tables without markers."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zipfile
from pathlib import Path

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.foreign_files import refuse_foreign
from formats.importers.marker_files import FILE_ENDINGS, read_marker_tracks
from formats.importers.swung_cloth import import_swung_cloth
from tests.formats.c3d_by_hand import c3d_bytes

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"4d" * 32 + b"\nsize 1437376\n"
PAGE = b"\n<!doctype HTML>\n<html><body>404 not found</body></html>\n" * 20
OWN = b"time_s,a_x_m,a_y_m,a_z_m\n" + b"".join(b"%.2f,1.25,%d,2\n" % (k / 100, k) for k in range(30))
IS_POINTER = "is a pointer of Git LFS, and not the file itself; fetch it with `git lfs pull`"
IS_PAGE = "is a web page; download the file itself; opened in a browser, the page may say why it came instead"
UNPACK = "unpack it, and give the file in it"


def zipped(folder: Path) -> bytes:
    with zipfile.ZipFile(folder / "z", "w") as archive:
        archive.writestr("a.csv", OWN)
    return (folder / "z").read_bytes()


@pytest.mark.parametrize("ending", FILE_ENDINGS)
@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda _: POINTER, IS_POINTER), (lambda _: PAGE, IS_PAGE), (lambda _: b"\xef\xbb\xbf<html>" * 99, IS_PAGE),
        (zipped, f"is a zip archive or a workbook of Excel; {UNPACK}, or save the table as .csv"),
        (lambda _: b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "is a workbook of Excel; save the table as .csv"),
        (lambda _: gzip.compress(OWN), f"is compressed by gzip; {UNPACK}"),
        (lambda _: bz2.compress(OWN), f"is a compressed archive; {UNPACK}"),
        (lambda _: lzma.compress(OWN), f"is a compressed archive; {UNPACK}"),
    ],
    ids=["pointer", "page", "page with a mark", "zip", "xls", "gzip", "bzip2", "xz"],
)  # fmt: skip
def test_a_file_that_no_motion_capture_wrote_says_what_it_is(tmp_path, ending, make, sentence):
    path = tmp_path / f"a{ending}"
    path.write_bytes(make(tmp_path))
    with pytest.raises(TakeError) as refused:
        read_marker_tracks(path)
    assert str(refused.value) == f"{path}: {sentence}"


@pytest.mark.parametrize(("raw", "sentence"), [(POINTER, IS_POINTER), (PAGE, IS_PAGE)], ids=["pointer", "page"])
def test_an_archive_of_arrays_that_was_not_fetched_says_what_it_is(tmp_path, raw, sentence):
    (tmp_path / "a.npz").write_bytes(raw)
    with pytest.raises(TakeError) as refused:
        import_swung_cloth(tmp_path / "a.npz")
    assert str(refused.value) == f"{tmp_path / 'a.npz'}: {sentence}"


def test_no_c3d_file_begins_as_a_foreign_one(tmp_path):
    """The first byte of a C3D file is the block of its parameters, and the second is 80."""
    raw = c3d_bytes(np.ones((20, 1, 3)), ["a"])
    for block in range(256):
        (tmp_path / "a.c3d").write_bytes(bytes([block]) + raw[1:])
        refuse_foreign(tmp_path / "a.c3d")


def vicon(section):
    return f"{section}\n100\n,,A:Knee,,\nFrame,Sub Frame,X,Y,Z\n,,deg,deg,deg\n1,0,1.5,2,3\n2,0,1.5,2,3\n"


@pytest.mark.parametrize("section", ["Model Outputs", "Joints", "Segments", "Devices", "Events"])
def test_an_export_of_vicon_without_trajectories_says_so(tmp_path, section):
    (tmp_path / "a.csv").write_text(vicon(section))
    with pytest.raises(TakeError) as refused:
        read_marker_tracks(tmp_path / "a.csv")
    assert str(refused.value) == (
        f"{tmp_path / 'a.csv'}: line 1 begins the section {section} of Vicon Nexus, and the file has no Trajectories; "
        "export it again with the trajectories of the markers"
    )


@pytest.mark.parametrize(
    ("text", "line", "name"),
    [
        ("Frame\tTime\ta X\ta Y\ta Z\n1\t0.00000\t1.5\t2\t3\n", 1, "a X"),
        ("Frame,Time,HEAD_X,HEAD_Y,HEAD_Z\n0,0.00,100.5,0,1700\n", 1, "HEAD_X"),
        ("walk 3\nframe;head.x;head.y;head.z\n0;100,5;0;1700\n", 2, "head.x"),
    ],
    ids=["qualisys without its header", "a bare time", "a title above"],
)
def test_columns_of_no_known_program_are_not_said_to_be_absent(tmp_path, text, line, name):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(TakeError) as refused:
        read_marker_tracks(tmp_path / "a.csv")
    assert str(refused.value) == (
        f"{tmp_path / 'a.csv'}: line {line} names columns such as {name!r}, and the file has neither the header of a "
        "known program nor a column time_s; export it again with its header, or name the columns "
        "time_s,NAME_x_m,NAME_y_m,NAME_z_m,... with three columns for each marker; mm for m where that is their unit"
    )
