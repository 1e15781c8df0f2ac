"""Swung-cloth recordings become complete takes, or are refused in one sentence."""

from __future__ import annotations

import struct
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from formats.archive import read_take
from formats.descriptions import dump_description, load_garment
from formats.errors import TakeError
from formats.importers import swung_cloth as module
from formats.importers.npz import load_arrays
from formats.importers.swung_cloth import WHAT_TO_GIVE, import_swung_cloth
from tests.formats.test_command_line import hangtime, swung_cloth


def changed(path, **changes):
    """A recording of 40 frames with other arrays, an array function of those that it has, or those times a factor."""
    swung_cloth(path)
    with np.load(path) as archive:
        data = dict(archive)
    for name, change in changes.items():
        is_factor = isinstance(change, float | list)
        data[name] = change(data[name]) if callable(change) else data[name] * change if is_factor else change
    np.savez(path, **data)
    return path


def with_value(place, value):
    def change(array):
        array[place] = value
        return array

    return change


IN_METRES = "Give 'points', 'hanger_corners' and 'rest' in metres"
OF_FRAMES = "its time does not increase from frame to frame, first at frame"
MEND = "mend 't', or leave that frame out of every array"
SECONDS = "ive seconds: divide milliseconds by 1e3, nanoseconds by 1e9, frame numbers by the frame rate"
NO_GRID = (
    "its {} places on the flat cloth ('rest') are no whole grid; give every place once, 9 or more of them, rows and "
    "columns along x and y"
)
UNSEEN = "no point was ever seen; give a recording that has finite points where `valid` is true"


def grid(rows, columns, **others):
    """The arrays of a recording of another grid, of 6 cm between its lines."""
    y, x = (0.06 * line.ravel() for line in np.mgrid[:rows, :columns])
    points = np.stack([x, 0 * x, y - 0.05], 1)[None].repeat(40, 0)
    return {"rest": np.stack([x, y], 1), "points": points, "valid": np.ones(points.shape[:2], bool), **others}


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"valid": lambda valid: valid & False}, UNSEEN),
        ({"points": lambda points: points + np.inf}, UNSEEN),
        ({"points": lambda points: points + 1e300}, "the array 'points' has places beyond 1000 m; export it in metres"),
        ({"points": with_value((3, 4, 1), -1000.1)},
         "the array 'points' has places beyond 1000 m; export it in metres"),
        ({"rest": with_value((3, 1), 1000.1)}, "the array 'rest' has places beyond 1000 m; export it in metres"),
        ({"hanger_corners": with_value((3, 1), 1000.1)},
         "the array 'hanger_corners' has places beyond 1000 m; export it in metres"),
        ({"t": with_value(3, np.nan)}, f"{OF_FRAMES} 3, at nan s; {MEND}"),
        ({"t": with_value(0, np.nan)}, f"{OF_FRAMES} 0, at nan s; {MEND}"),
        ({"points": with_value((4, 9, 1), -np.inf)}, "its 'points' hold inf, which is no number, at frame 4, place 9; "
         "export it again, with places that were not seen as NaN"),
        ({"hanger_corners": with_value((slice(7, 9), 1, 2), np.inf)}, "its 'hanger_corners' hold inf, which is no "
         "number, at frame 7, place 1, the first of 2 such places; export it again, with places that were not seen as "
         "NaN"),
        ({"t": with_value(slice(38, 40), np.inf)}, f"{OF_FRAMES} 38, at inf s; {MEND}"),
        ({"t": with_value(7, 0.1)}, f"{OF_FRAMES} 7, at 0.1 s; {MEND}"),
        ({"t": with_value(7, 6 * 0.11 - 0.34)}, f"{OF_FRAMES} 7, at 0.32 s; {MEND}"),
        ({"t": lambda t: 1e3 * t}, f"its frames are 110 s apart in the median; are these milliseconds? G{SECONDS}"),
        ({"t": lambda t: 1e9 * t}, f"its frames are 1.1e+08 s apart in the median; are these nanoseconds? G{SECONDS}"),
        ({"t": np.arange(40.0)}, "its frames are 1 s apart in the median; its times are frame numbers, or milliseconds "
         f"at 1000 frames a second; g{SECONDS}"),
        ({"t": lambda t: t[:-1]}, f"the array 'points' has shape (40, 64, 3), not (39, 64, 3); {WHAT_TO_GIVE}"),
        ({"points": lambda points: points[:, 0]},
         f"the array 'points' has shape (40, 3), not (40, 0, 3); {WHAT_TO_GIVE}"),
        ({"points": lambda points: points[..., :2]},
         f"the array 'points' has shape (40, 64, 2), not (40, 64, 3); {WHAT_TO_GIVE}"),
        ({"valid": lambda valid: valid[:-1]}, f"the array 'valid' has shape (39, 64), not (40, 64); {WHAT_TO_GIVE}"),
        ({"valid": lambda valid: valid[:, :9]}, f"the array 'valid' has shape (40, 9), not (40, 64); {WHAT_TO_GIVE}"),
        ({"hanger_corners": lambda held: held[:, 0]},
         f"the array 'hanger_corners' has shape (40, 3), not (40, 2, 3); {WHAT_TO_GIVE}"),
        ({"rest": lambda rest: rest[:8]}, f"the array 'rest' has shape (8, 2), not (64, 2); {WHAT_TO_GIVE}"),
        ({"rest": with_value((5, 1), 0.02)}, NO_GRID.format(64)),
        ({"rest": with_value(5, 0.0)}, NO_GRID.format(64)),
        (grid(2, 4), NO_GRID.format(8)),
        ({"t": np.array(0.5)}, f"the array 't' has shape (), not (0,); {WHAT_TO_GIVE}"),
        ({"t": lambda t: np.array([f"{second:.2f} s" for second in t])},
         f"the array 't' holds text, not real numbers; {WHAT_TO_GIVE}"),
        ({"points": lambda points: points + 1j},
         f"the array 'points' holds complex numbers, not real numbers; {WHAT_TO_GIVE}"),
        ({"t": lambda t: (1e3 * t).astype("M8[ms]")}, f"the array 't' holds dates, not real numbers; {WHAT_TO_GIVE}"),
        ({"valid": lambda valid: valid.astype([("seen", "i1")])},
         f"the array 'valid' holds records, not real numbers; {WHAT_TO_GIVE}"),
        ({"rest": with_value((5, 1), np.nan)},
         "a place on the flat cloth ('rest') is not a number; export it again"),
        (dict.fromkeys(("t", "points", "valid", "hanger_corners"), lambda array: array[:0]),
         "has no frames; export it again"),
        ({"t": lambda t: t.astype(object)}, f"is an .npz archive that is damaged or holds objects; {WHAT_TO_GIVE}"),
        ({"rest": 1e3}, "its cloth is 300 m long in 'rest', a garment 0.1 to 3 m; were millimetres or centimetres "
         "meant? Give metres"),
        ({"rest": 10.1}, "its cloth is 3.03 m long in 'rest', a garment 0.1 to 3 m; give metres"),
        ({"rest": 0.33}, "its cloth is 0.099 m long in 'rest', a garment 0.1 to 3 m; give metres"),
        ({"points": 1e3, "hanger_corners": 1e3}, "its points are 1e+03 times as far apart as in 'rest'; are these "
         f"millimetres that were taken for metres? {IN_METRES}"),
        ({"points": 1e2}, "its points are 100 times as far apart as in 'rest'; are these centimetres that were taken "
         f"for metres? {IN_METRES}"),
        ({"points": 1.61}, f"its points are 1.61 times as far apart as in 'rest'; g{IN_METRES[1:]}"),
        ({"points": 0.39}, "its points are 0.39 times as far apart as in 'rest'; are these inches that were taken "
         f"for centimetres? {IN_METRES}"),
        ({"hanger_corners": 1e2}, "its hanger_corners are 31.7 m from the held row of its points, in the median; give "
         "both in metres, in one frame and at the same times"),
        ({"hanger_corners": lambda held: held + np.array([0, 0.151, 0])}, "its hanger_corners are 0.151 m from "
         "the held row of its points, in the median; give both in metres, in one frame and at the same times"),
        ({"points": [1, 1, -1], "hanger_corners": [1, 1, -1]}, "its points lie above its hanger_corners, in the "
         "median; turn both so that z points up"),
    ],
)  # fmt: skip
def test_arrays_that_are_no_recording_are_refused_with_what_is_wrong_and_what_to_do(tmp_path, changes, sentence):
    with pytest.raises(TakeError) as refused:
        import_swung_cloth(changed(tmp_path / "r.npz", **changes))
    assert str(refused.value) == f"{tmp_path}/r.npz: {sentence}"


@pytest.mark.parametrize(
    "changes",
    [
        grid(3, 3, hanger_corners=lambda held: held * [0.4, 1, 0.28]),
        {"rest": 9.9, "points": 9.9, "hanger_corners": 9.9},
        {"rest": 0.34, "points": 0.34, "hanger_corners": 0.34},
        {"points": 1.59}, {"points": 0.41, "hanger_corners": 0.41},
        {"hanger_corners": lambda held: held + np.array([0, 0.149, 0])},
        {"hanger_corners": lambda held: held * np.nan},
        {"valid": lambda valid: valid & (np.arange(64) % 2 == 0)},
        {"t": lambda t: t[:1], **dict.fromkeys(("points", "valid", "hanger_corners"), lambda array: array[:1])},
    ],
    ids=["nine points", "large", "small", "stretched", "folded", "corners aside", "no corners", "no neighbours", "one"],
)  # fmt: skip
def test_arrays_just_within_the_bounds_are_a_recording(tmp_path, changes):
    assert import_swung_cloth(changed(tmp_path / "r.npz", **changes)).points_valid.any()


def spoilt(raw):
    return raw[:200] + bytes(len(raw) - 400) + raw[-200:]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda raw: b"", f"is empty; {WHAT_TO_GIVE}"),
        (lambda raw: raw[:300], "no end of its archive was found: it is cut off, or damaged at its end; copy or export "
         "it again"),
        (spoilt, f"is an .npz archive that is damaged or holds objects; {WHAT_TO_GIVE}"),
        (lambda raw: raw[1:300], f"is no .npz archive; {WHAT_TO_GIVE}"),
    ],
    ids=["empty", "cut", "spoilt", "other"],
)  # fmt: skip
def test_bytes_that_are_no_archive_are_refused(tmp_path, change, said):
    swung_cloth(tmp_path / "r.npz")
    (tmp_path / "r.npz").write_bytes(change((tmp_path / "r.npz").read_bytes()))
    with pytest.raises(TakeError) as refused:
        import_swung_cloth(tmp_path / "r.npz")
    assert str(refused.value) == f"{tmp_path}/r.npz: {said}"


def test_a_single_array_under_the_name_of_an_archive_gives_one_sentence_and_exit_code_2(tmp_path):
    np.save(tmp_path / "r.npy", np.arange(9.0))
    done = hangtime("import", (tmp_path / "r.npy").rename(tmp_path / "r.npz"), "--out", tmp_path / "takes")
    assert done.returncode == 2
    assert "r.npz: is no .npz archive; give marker paths" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "takes").exists()


def test_every_frame_is_kept_and_points_that_are_not_numbers_are_not_valid(tmp_path):
    take = import_swung_cloth(changed(tmp_path / "r.npz", points=with_value((4, 9), np.nan)))
    assert len(take.time) == 40
    assert (~take.points_valid).sum() == 1
    assert not take.points_valid[4, 9]


def test_an_infinite_place_counts_as_not_seen_where_the_file_says_so(tmp_path):
    unseen = {"points": with_value((4, 9), np.inf), "valid": with_value((4, 9), False)}
    take = import_swung_cloth(changed(tmp_path / "r.npz", **unseen))
    assert np.argwhere(~take.points_valid).tolist() == [[4, 9]]


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64, float])
def test_the_held_corners_keep_their_order_whatever_numbers_say_what_is_seen(tmp_path, kind):
    """A corner that is unseen in the second frame must not turn the corners round."""
    plain = import_swung_cloth(changed(tmp_path / "a.npz"))
    points, valid = with_value((1, slice(None)), np.nan), with_value((1, slice(None)), 0)
    take = import_swung_cloth(changed(tmp_path / "r.npz", points=points, valid=lambda v: valid(v.astype(kind))))
    assert (take.held == plain.held).all()


def test_a_recording_becomes_a_take_with_the_figures_of_its_maker(tmp_path):
    """Cloth of the median fabric's 0.197 kg/m^2; noise of 2.8, 1.9 and 2.8 mm, 2 mm at the robot's hands."""
    with np.load(changed(tmp_path / "r.npz")) as archive:
        rest, time = archive["rest"], archive["t"]
    take = import_swung_cloth(changed(tmp_path / "r.npz", t=time + 3.0, rest=rest + np.array([0.7, -0.3])))
    width, height = np.ptp(rest, axis=0)
    assert take.garment.mass_kg == pytest.approx(0.197 * width * height, rel=1e-4)
    places = np.array([point.at_m for point in take.garment.points])
    assert places == pytest.approx(rest - [rest[:, 0].mean(), rest[:, 1].max()], abs=2e-6)
    half = width / 2
    assert np.array(take.garment.outline_m) == pytest.approx(
        np.array([(-half, 0.0), (half, 0.0), (half, -height), (-half, -height)]), abs=2e-6
    )
    assert [take.garment.points[k].name for k in (0, 9, 63)] == ["row0_column0", "row1_column1", "row7_column7"]
    assert take.time == pytest.approx(time - time[0])
    assert (take.points_sd == [0.0028, 0.0019, 0.0028]).all()
    assert (take.held_sd == 0.002).all()
    assert take.rig.gravity == (0.0, 0.0, -1.0)
    assert take.garment.held == "edge"


def test_exchanged_hands_are_put_in_order_and_a_missing_one_is_not_valid(tmp_path):
    plain = import_swung_cloth(changed(tmp_path / "a.npz"))
    turned = import_swung_cloth(changed(tmp_path / "b.npz", hanger_corners=lambda held: held[:, ::-1]))
    assert turned.held == pytest.approx(plain.held)
    gone = import_swung_cloth(changed(tmp_path / "c.npz", hanger_corners=with_value((5, 1, 2), np.nan)))
    assert (~gone.held_valid).sum() == 1
    assert not gone.held_valid[5].all()


def test_any_whole_grid_is_imported_and_its_points_are_a_silhouettes(tmp_path):
    """5 rows of 7: the last one is held, and names go by row from the bottom and column from the left."""
    x, y = np.meshgrid(np.linspace(0, 0.3, 7), np.linspace(0, 0.2, 5))
    rest = np.stack([x.ravel(), y.ravel()], 1)
    points = np.stack([rest[:, 0], 0 * rest[:, 0], rest[:, 1]], 1)[None].repeat(40, 0)
    take = import_swung_cloth(
        changed(
            tmp_path / "r.npz", rest=rest, points=points, valid=np.ones((40, 35)), hanger_corners=points[:, [28, 34]]
        )
    )
    assert take.points.shape == (40, 35, 3)
    assert take.garment.point_names[9] == "row1_column2"
    assert take.garment.points[9].at_m == pytest.approx((-0.05, -0.15))
    assert take.garment.point_kind == "silhouette"
    assert (take.held == points[:, [28, 34]]).all()


def described(folder, out=slice(None), **changes):
    """A garment file like the one of `swung_cloth`, weighed, its origin elsewhere, points in another order."""
    swung_cloth(folder / "whole.npz")
    garment = import_swung_cloth(folder / "whole.npz").garment
    moved = [replace(p, at_m=(p.at_m[0] + 1.0, p.at_m[1] + 2.0)) for p in reversed(garment.points)][out]
    outline = tuple((x + 1.0, y + 2.0) for x, y in garment.outline_m)
    whole = replace(garment, name="my cloth", mass_kg=0.02, points=tuple(moved), outline_m=outline)
    (folder / "mine.toml").write_text(dump_description(replace(whole, **changes)))
    return folder / "mine.toml"


def test_a_described_garment_gives_weight_and_order_to_a_grid(tmp_path):
    path = described(tmp_path, points_are=None)
    done = hangtime("import", tmp_path / "whole.npz", "--garment", path, "--out", tmp_path / "takes")
    assert done.returncode == 0, done.stderr
    plain, take = import_swung_cloth(tmp_path / "whole.npz"), read_take(tmp_path / "takes" / "whole.mcap")
    assert take.garment.mass_kg == 0.02
    assert take.garment.points_are == "silhouette"
    assert take.points == pytest.approx(plain.points[:, ::-1], abs=1e-4)  # steps of an archive
    assert "mass" not in take.notes


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"held": "corners"}, "its cloth is 0.3 m x 0.3 m and held along its top edge, the described garment is not"),
        ({"outline_m": ((0.8, 2.0), (1.2, 2.0), (1.2, 1.7), (0.8, 1.7))}, "its cloth is 0.3 m x 0.3 m"),
    ],
)
def test_a_described_garment_of_another_cloth_is_refused(tmp_path, changes, sentence):
    garment = load_garment(described(tmp_path, **changes))
    with pytest.raises(TakeError, match=sentence):
        import_swung_cloth(tmp_path / "whole.npz", garment)


def test_a_described_point_that_the_file_has_not_is_refused_by_name(tmp_path):
    garment = load_garment(described(tmp_path))
    astray = replace(garment, points=(replace(garment.points[0], name="pocket", at_m=(1.01, 1.9)), *garment.points[1:]))
    with pytest.raises(TakeError, match="has no point where the described garment has 'pocket'"):
        import_swung_cloth(tmp_path / "whole.npz", astray)


def test_an_array_whose_head_is_cut_is_one_sentence(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("t.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", 9) + b'{"descr":')
    with pytest.raises(TakeError, match=r"is an \.npz archive that is damaged or holds objects"):
        load_arrays(tmp_path / "a.npz", ["t"], most_bytes=8000, advice="give less")


def test_arrays_of_small_numbers_count_as_what_an_import_makes_of_them(tmp_path):
    """A thousand numbers of one byte are eight thousand bytes; an archive of 1.5 MB once took 8 GB."""
    np.savez(tmp_path / "a.npz", t=np.zeros(1000, np.int8))
    assert load_arrays(tmp_path / "a.npz", ["t"], most_bytes=8000, advice="give less")["t"].shape == (1000,)
    with pytest.raises(TakeError, match=r"its arrays have [0-9.]+ [kM]B; import shorter recordings"):
        load_arrays(tmp_path / "a.npz", ["t"], most_bytes=7999, advice="give less")


def test_a_cloth_of_unknown_weight_weighs_what_its_width_times_its_height_of_the_median_fabric_does(tmp_path):
    """Four columns and five rows 6 cm apart: 0.197 kg/m2 x 0.18 m x 0.24 m."""
    ends = np.array([[[0.0, 0.0, 0.19], [0.18, 0.0, 0.19]]]).repeat(40, 0)
    take = import_swung_cloth(changed(tmp_path / "a.npz", **grid(5, 4, hanger_corners=ends)))
    assert take.garment.mass_kg == pytest.approx(0.197 * 0.18 * 0.24, abs=1e-6)
    assert take.garment.outline_m == ((-0.09, 0.0), (0.09, 0.0), (0.09, -0.24), (-0.09, -0.24))


@pytest.mark.parametrize(
    ("corners", "checked"),
    [
        (with_value((5, 1, 2), np.nan), "pictures"),
        (lambda held: held * np.nan, "points"),
        (lambda held: held, "pictures"),
    ],
)
def test_an_arms_path_is_compared_with_the_corners_that_were_seen_and_else_with_the_points(
    tmp_path, monkeypatch, corners, checked
):
    path, asked = changed(tmp_path / "a.npz", hanger_corners=corners), []
    whole = np.load(changed(tmp_path / "whole.npz"))
    arm = SimpleNamespace(time=whole["t"].astype(float), held=whole["hanger_corners"].astype(float), file=path)
    monkeypatch.setattr(module, "read_arm_path", lambda *given, **options: arm)
    monkeypatch.setattr(module, "check_arm_path", lambda *given: asked.append("pictures") or "")
    monkeypatch.setattr(module, "check_clock", lambda *given: asked.append("points") or "")
    import_swung_cloth(path, hanger=path)
    assert asked == [checked]
