"""What the commands make of their options: the scene, the figure, the order and the picture's size."""

from __future__ import annotations

import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.export import animation, kinds
from fit.export.animation import Animated, Scene, check_film
from fit.export.kinds import Order
from fit.export.worn import FigureOrder
from formats.archive import write_take
from formats.results import save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, sheet, swing, take_of


@pytest.fixture
def folder(tmp_path):
    save_fit_result(tmp_path / "fit.json", a_fit())
    time = np.arange(0, 0.8, 1 / 30)
    write_take(tmp_path / "swing.mcap", take_of(sheet(), time, swing(time), hung(sheet(), time)))
    return tmp_path


@pytest.fixture
def asked(monkeypatch):
    """The scenes that a film is asked of, with the other words."""
    scenes = []

    def animate(scene, path, **more):
        scenes.append((scene, path, more["size"], more["overwrite"]))
        return Animated(path, ("It is tight.",))

    monkeypatch.setattr(animation, "animate", animate)
    return scenes


@pytest.mark.parametrize(
    ("words", "motion", "seconds", "figure"),
    [
        (["--motion", "twist"], "twist", 6.0, None),
        (["--motion", "mixed", "--seconds", "3"], "mixed", 3.0, None),
        (["--figure", "walk"], "", 6.0, FigureOrder()),
        (["--figure", "walk", "--wear", "t-shirt", "--speed", "0.9", "--height", "1.8", "--seconds", "5"], "", 5.0,
         FigureOrder(wear="t-shirt", speed=0.9, height=1.8)),
        (["--bvh", "a.bvh", "--height", "1.8"], "", 6.0, FigureOrder(bvh=Path("a.bvh"), height=1.8)),
    ],
)  # fmt: skip
def test_a_scene_is_what_the_options_say(folder, asked, words, motion, seconds, figure):
    done = hangtime_here("animate", ".", "--out", "a.gif", *words, folder=folder)
    assert (done.returncode, done.stdout, done.stderr.splitlines()[-1]) == (0, "a.gif\n", "It is tight.")
    ((scene, path, size, overwrite),) = asked
    assert (scene.result, scene.take, scene.spacing) == (a_fit(), None, None)
    assert (scene.motion, scene.seconds, scene.figure) == (motion, seconds, figure)
    assert (path, size, overwrite) == (Path("a.gif"), (960, 720), False)


def test_a_takes_own_motion_is_asked_for_with_its_size_and_mesh(folder, asked):
    words = ("--take", "swing.mcap", "--size", "320x240", "--spacing", "0.1", "--overwrite")
    assert hangtime_here("animate", ".", "--out", "a.mp4", *words, folder=folder).returncode == 0
    ((scene, _, size, overwrite),) = asked
    assert (scene.take.take_id, scene.motion, scene.figure, scene.spacing) == ("scene", "", None, 0.1)
    assert (size, overwrite) == ((320, 240), True)


@pytest.mark.parametrize("command", ["animate", "export"])
def test_an_interrupted_command_keeps_nothing_and_ends_with_130(folder, monkeypatch, command):
    def interrupt(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(animation, "animate", interrupt)
    monkeypatch.setattr(kinds, "contents", interrupt)
    words = ["--out", "a.gif", "--motion", "twist"] if command == "animate" else ["--to", "csv"]
    done = hangtime_here(command, ".", *words, folder=folder)
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1] == "Interrupted; nothing is kept."
    assert sorted(p.name for p in folder.iterdir()) == ["fit.json", "swing.mcap"]


@pytest.mark.parametrize(
    ("size", "is_refused"),
    [((64, 64), False), ((62, 64), True), ((64, 62), True), ((4096, 64), False), ((4098, 64), True), ((65, 64), True)],
)
def test_a_film_has_even_numbers_of_pixels_from_64_to_4096(tmp_path, size, is_refused):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    if is_refused:
        with pytest.raises(FitError, match=f"cannot have {size[0]} x {size[1]} pixels"):
            check_film(tmp_path / "a.gif", size)
    else:
        check_film(tmp_path / "a.gif", size)


def test_a_name_without_an_ending_or_with_an_unknown_one_is_no_film(tmp_path):
    others = r"give one of: \.mp4, \.webm, \.gif, \.usdc, \.glb$"
    for name, said in (
        ("a", f"has no ending, which names the format; {others}"),
        ("a.avi", rf"\.avi is no format for motion; {others}"),
        ("a.mp5", r"\.mp5 is no format for motion; did you mean \.mp4\? The others: \.webm, \.gif, \.usdc, \.glb$"),
    ):  # fmt: skip
        with pytest.raises(FitError, match=said):
            check_film(tmp_path / name)
    check_film(tmp_path / "a.GLB")


def test_a_scene_needs_one_source_of_motion():
    """A figure moves by itself; a fit without a fabric needs a take."""
    with pytest.raises(FitError, match="a figure moves by itself"):
        Scene(result=a_fit(), motion="twist", figure=FigureOrder()).check()
    with pytest.raises(FitError, match="a fit alone holds no motion"):
        Scene(result=a_fit()).check()
    Scene(result=a_fit()).check(has_take=True)
    Scene(result=a_fit(), motion="twist").check()
    for scene in (Scene(result=a_fit("kinect-skirt"), motion="twist"),
                  Scene(result=a_fit("kinect-skirt"), figure=FigureOrder())):  # fmt: skip
        with pytest.raises(FitError, match="none of its numbers has an SI value"):
            scene.check()
        scene.check(has_take=True)
    with pytest.raises(FitError, match="its cloth is blender's, which keeps no shapes"):
        Scene(result=a_fit("kinect-skirt", engine="blender")).check(has_take=True)
    with pytest.raises(FitError, match="no figure wears 'hat'"):
        Scene(result=a_fit(), figure=FigureOrder(wear="hat")).check()


def test_a_scene_is_simulated_on_the_mesh_of_the_fit_or_of_a_swatch_and_seams_keep_layers_apart(monkeypatch, folder):
    made = []
    monkeypatch.setattr(
        animation, "motion_of", lambda result, recording, spacing, **more: made.append((recording, spacing, more))
    )
    time = np.arange(0, 0.8, 1 / 30)
    take = take_of(sheet(), time, swing(time), hung(sheet(), time))
    sewn = msgspec.structs.replace(sheet(), format="hangtime-garment/2", seams=((1, 2), (3, 0)))
    both = take_of(sewn, time, swing(time), hung(sewn, time))
    for scene in (
        Scene(result=a_fit(), take=take), Scene(result=a_fit(), take=both, motion="twist", seconds=3.0),
        Scene(result=a_fit(), motion="twist", seconds=4.0), Scene(result=a_fit(), motion="twist", spacing=0.05),
    ):  # fmt: skip
        scene.moving()
    assert [spacing for _, spacing, _ in made] == [None, None, 0.02, 0.05]
    assert [more["layers_apart"] for _, _, more in made] == [0.0, 2e-3, 0.0, 0.0]
    assert [recording.duration for recording, _, _ in made] == pytest.approx([time[-1], 3.0, 4.0, 6.0])
    assert made[0][0].garment == sheet()
    assert made[2][0].garment.kind == "swatch"


def test_an_order_of_an_export_is_what_the_options_say(folder, monkeypatch):
    orders, written = [], []
    monkeypatch.setattr(kinds, "contents", lambda order, kind, names: orders.append((order, kind, names)) or {})
    monkeypatch.setattr(kinds, "write_contents", lambda made, overwrite: written.append(overwrite))
    words = ("--to", "usd-physics", "--take", "swing.mcap", "--thickness", "0.0005", "--spacing", "0.1", "--overwrite")
    assert hangtime_here("export", ".", *words, "--out", "x.usda", folder=folder).returncode == 0
    hangtime_here("export", ".", "--to", "gltf", folder=folder)
    (first, kind, names), (second, other, default) = orders
    assert (kind, names, written) == ("usd-physics", {".physics.usda": Path("x.usda")}, [True, False])
    assert (first.take.take_id, first.thickness, first.spacing) == ("scene", 5e-4, 0.1)
    assert (other, {end: path.name for end, path in default.items()}) == ("gltf", {".glb": "fit.glb"})
    assert (second.take, second.thickness, second.spacing) == (None, 1e-3, None)
    refused = hangtime_here("export", ".", "--to", "csv", "--thickness", "0.001", folder=folder)
    assert "--thickness: changes nothing here: csv holds none" in refused.stderr


def test_the_sheet_of_an_order_is_a_swatch_of_thirty_centimetres_or_the_takes_garment_with_all_its_layers():
    time = np.arange(0, 0.8, 1 / 30)
    take = take_of(sheet(), time, swing(time), hung(sheet(), time))
    swatch = Order(result=a_fit(layers=2)).sheet
    assert np.ptp(swatch.rest, axis=0) == pytest.approx([0.3, 0.3])
    assert len(swatch.rest) == 16 * 16  # 2 cm apart
    assert len(Order(result=a_fit(), spacing=0.1).sheet.rest) == 16
    one, whole = (Order(result=a_fit(layers=2), take=t).sheets_fabric["shear"].value for t in (None, take))
    assert (one, whole) == (pytest.approx(15.0), pytest.approx(30.0))
    assert Order(result=a_fit("kinect-skirt")).fabric_if_any is None
    assert Order(result=a_fit()).grid_spacing == 0.02


def test_files_are_written_from_another_thread_too(tmp_path):
    """Only the main thread can let an interruption wait."""
    failed = []

    def write():
        try:
            kinds.write_contents({tmp_path / "a.csv": b"a", tmp_path / "b.csv": b"b"})
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=write)
    thread.start()
    thread.join()
    assert failed == []
    assert [(tmp_path / f"{name}.csv").read_bytes() for name in "ab"] == [b"a", b"b"]


@pytest.mark.parametrize("words", [(), ("--overwrite",)])
@pytest.mark.parametrize("place", [".", "/"])
def test_a_place_without_a_name_is_refused_as_the_folder_that_it_is(tmp_path, place, words):
    save_fit_result(tmp_path / "fit.json", a_fit())
    done = hangtime_here("export", "fit.json", "--to", "csv", "--out", place, *words, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"hangtime: {place}: is a folder; give another name\n"
