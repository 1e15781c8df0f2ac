"""`hangtime animate`: new motions of a hanger, pictures of the cloth, and films that decode again."""

from __future__ import annotations

import dataclasses
import io

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.export.animation import Scene, animate
from fit.export.drawing import LINE, SHADOW, SKY, TITLE_LINES, Stage, node_normals
from fit.export.fabric import fabric_of
from fit.export.moving import Moving, motion_of
from fit.export.new_motion import AMPLITUDE, displaced, hung_swatch, new_motion
from fit.export.worn import FigureOrder
from fit.recordings.recording import prepare
from fit.recordings.selection import content_of_garment
from formats.archive import write_take
from formats.errors import OutputError
from formats.motion import reach_of
from formats.results import save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, sheet, swing, take_of

ENDS = np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]])
SMALL = (160, 120)


def a_take(seconds=0.8):
    time = np.arange(0, seconds, 1 / 30)
    return take_of(sheet(), time, swing(time, amplitude=0.1, hz=1.5, start=0.0), hung(sheet(), time))


@pytest.fixture(scope="module")
def scene():
    return Scene(result=a_fit(), take=a_take(), spacing=0.15)


@pytest.fixture(scope="module")
def moving(scene):
    return scene.moving()


@pytest.mark.parametrize("way", ["sideways", "face-on", "up-and-down", "twist"])
def test_a_new_motion_is_of_the_kind_that_it_is_called(way):
    """`formats.motion` finds it; it begins and ends where it hangs, and never leaves its amplitude."""
    time = np.arange(0, 6, 1 / 30)
    ends = displaced(ENDS, way, time, 6.0).reshape(-1, 2, 3)
    still = take_of(sheet(), time, np.zeros((len(time), 3)), hung(sheet(), time))
    reach = reach_of(dataclasses.replace(still, held=ends))
    assert max(reach, key=reach.get) == way
    assert ends[0] == pytest.approx(ENDS)
    assert ends[-1] == pytest.approx(ENDS)
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(0.4)
    if way in AMPLITUDE:
        assert 0.9 * AMPLITUDE[way] < np.abs(ends - ENDS).max() <= AMPLITUDE[way] + 1e-9


def test_a_swatch_without_a_take_weighs_what_the_fabric_does():
    recording = hung_swatch(fabric_of(a_fit()))
    assert recording.garment.areal_density == pytest.approx(0.2)
    assert new_motion(recording, "twist", 3.0).duration == pytest.approx(3.0)


def test_unknown_motions_and_lengths_are_refused():
    recording = hung_swatch(fabric_of(a_fit()))
    with pytest.raises(FitError, match="there is no motion named 'salto'; known: sideways"):
        new_motion(recording, "salto", 3.0)
    with pytest.raises(FitError, match="600 s is no length"):
        new_motion(recording, "twist", 600.0)
    assert new_motion(recording, "twist", 60.0).duration == pytest.approx(60.0)
    with pytest.raises(FitError, match="name a take, or a --motion for a swatch of the fabric"):
        Scene(result=a_fit()).moving()


def test_what_is_twice_as_far_from_the_camera_is_half_as_large(moving):
    camera = Stage(moving, (320, 240))
    sizes = []
    for share in (0.0, 1.0):  # at the middle of the view, and as far again behind it
        middle = camera._middle + share * camera._distance * camera._axes[2]
        ends = np.stack([middle, middle + 0.1 * camera._axes[0]])
        seen = camera._project(ends, np.zeros(3), 1.0, (0.0, 0.0))
        sizes.append(seen[1, 0] - seen[0, 0])
    assert sizes == pytest.approx([0.1, 0.05])


def test_normals_of_a_flat_square_point_to_its_front():
    places = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], float)
    normals = node_normals(places, np.array([[0, 1, 2], [0, 2, 3]]))
    assert normals == pytest.approx(np.tile([0.0, -1.0, 0.0], (4, 1)))


def square(turn):
    """A square of cloth of 0.2 m that shows its front, turned about the vertical."""
    x = np.array([-0.1, 0.1, 0.1, -0.1])
    z = np.array([-0.2, -0.2, 0.0, 0.0])
    places = np.stack([x * np.cos(turn), x * np.sin(turn), z], 1).astype(np.float32)
    held = places[[3, 2]].astype(float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return Moving("square", np.array([0.0, 1.0]), np.stack([places] * 2), triangles, np.stack([x, z], 1),
                  np.zeros((2, 0, 3)), (), np.stack([held] * 2))  # fmt: skip


def test_the_camera_stands_52_degrees_beside_and_10_degrees_above_the_cloth():
    """Its axes are the world's, turned by 52 degrees about the vertical, then by 10 about its own right."""
    b, a = np.radians([52.0, 10.0])
    beside = np.array([[np.cos(b), np.sin(b), 0], [-np.sin(b), np.cos(b), 0], [0, 0, 1]])  # right, away, up
    above = np.array([[1, 0, 0], [0, np.sin(a), np.cos(a)], [0, np.cos(a), -np.sin(a)]])  # right, up, away
    stage = Stage(square(0.0), SMALL)
    assert stage._axes == pytest.approx(above @ beside, abs=1e-12)
    seen = stage._project(stage._middle + 0.1 * stage._axes[1:], np.zeros(3), 100.0, (80, 60))
    far = stage._distance
    assert seen[0] == pytest.approx([80, 50, far])  # 0.1 m up at 100 px/m
    assert seen[1] == pytest.approx([80, 60, far + 0.1])  # 0.1 m along its view


def test_a_picture_shows_the_front_blue_the_back_brown_and_fills_most_of_its_height():
    pytest.importorskip("PIL", reason="Pillow is not installed")
    front = np.asarray(Stage(square(0.0), SMALL).picture(0)).astype(int)
    back = np.asarray(Stage(square(np.pi), SMALL).picture(0)).astype(int)
    is_cloth = front[..., 2] > front[..., 0] + 20
    rows = np.flatnonzero(is_cloth.any(1))
    assert 0.6 * SMALL[1] < len(rows) < SMALL[1]
    assert is_cloth.mean() > 0.15  # seen from the side: cos 52 degrees of its width
    assert (back[..., 0] > back[..., 2] + 20).mean() > 0.15
    assert not (back[..., 2] > back[..., 0] + 20).any()
    assert tuple(front[-1, -1]) == SKY


@pytest.mark.parametrize(
    ("name", "shown"), [("a\nb", r"a\nb"), ("a\r\u2028b", r"a\r\u2028b"), ("\udcff\x1b[2J", r"\udcff\x1b[2J")]
)
def test_a_take_whose_name_has_a_line_break_or_a_code_is_drawn_with_its_escapes(name, shown):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    pictures = [
        np.asarray(Stage(dataclasses.replace(square(0.0), name=one), (640, 480)).picture(0))
        for one in (name, shown, "other")
    ]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


def test_cloth_hangs_above_a_floor_with_lines_and_its_shadow():
    """Cloth that is swung out casts a shadow of its depth."""
    pytest.importorskip("PIL", reason="Pillow is not installed")
    places = square(0.0).places.copy()
    places[..., 1] = 0.7 * places[..., 2]
    picture = np.asarray(Stage(dataclasses.replace(square(0.0), places=places), (320, 240)).picture(0)).astype(int)
    assert (picture == SHADOW).all(2).sum() > 50
    assert (np.abs(picture - LINE).max(2) < 4).sum() > 100


@pytest.mark.parametrize("size", [(960, 720), (320, 240), (64, 640), (160, 120)])
def test_words_never_lie_on_the_cloth_and_leave_a_small_picture_to_it(size):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    picture = np.asarray(Stage(square(0.0), size).picture(0)).astype(int)
    is_cloth = picture[..., 2] > picture[..., 0] + 20
    kept = round(TITLE_LINES * max(size[1] / 45, 10))
    is_word = (picture[:kept] < 150).all(2) & ~is_cloth[:kept]
    if size[1] < 200:
        assert np.flatnonzero(is_cloth.any(1))[0] < kept
    else:
        assert not is_cloth[:kept].any()
        assert is_word.any()


@pytest.mark.parametrize(("suffix", "name"), [(".mp4", "h264"), (".webm", "vp9")])
def test_a_film_decodes_to_as_many_pictures_at_the_takes_rate(scene, suffix, name, tmp_path):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    path = animate(scene, tmp_path / f"swing{suffix}", size=SMALL).path
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(video=0)]
        assert stream.codec_context.name in {name, "av1", "libdav1d", "libsvtav1"}
        assert float(stream.average_rate) == pytest.approx(30.0, rel=1e-3)
        comments = {k.lower(): v for k, v in container.metadata.items()}
        assert "Fitted by hangtime" in comments["comment"]
    assert len(pictures) == 24
    assert pictures[0].shape == (120, 160, 3)
    assert np.abs(pictures[20] - pictures[0]).mean() > 1.0  # the cloth moved


def test_a_gif_plays_as_long_as_the_take(scene, tmp_path):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    path = animate(scene, tmp_path / "swing.gif", size=SMALL).path
    with image.open(path) as gif:
        shown = []
        for number in range(gif.n_frames):
            gif.seek(number)
            shown.append(gif.info["duration"])
        assert sum(shown) / 1000 == pytest.approx(0.8, abs=0.06)
        assert b"Fitted by hangtime" in gif.info["comment"]


def test_the_progress_ends_at_one_and_says_what_is_done(scene, tmp_path):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    told = []
    animate(scene, tmp_path / "swing.gif", size=SMALL, show=lambda share, text: told.append((share, text)))
    assert told[0] == (0.0, "simulating")
    assert told[-1][0] == 1.0
    assert [text for _, text in told] == sorted((text for _, text in told), reverse=True)
    assert {text for _, text in told} == {"simulating", "drawing"}
    assert [share for share, _ in told] == sorted(share for share, _ in told)


def test_an_animation_as_gltf_is_the_motion(scene, moving, tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    path = animate(scene, tmp_path / "swing.glb").path
    (mesh,) = trimesh.load(io.BytesIO(path.read_bytes()), file_type="glb").geometry.values()
    assert np.ptp(mesh.bounds[:, 1]) == pytest.approx(np.ptp(moving.places[0][:, 2]), abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"path": "swing.avi"}, "avi is no format for motion"),
        ({"size": (161, 120)}, "a film cannot have 161 x 120 pixels"),
        ({"scene": Scene(result=a_fit())}, "a fit alone holds no motion"),
        (
            {"scene": Scene(result=a_fit(), take=a_take(), figure=FigureOrder())},
            "the figure wears skirts and T-shirts, and sheet is",
        ),
        ({"scene": Scene(result=a_fit("kinect-skirt"), motion="twist")}, "none of its numbers has an SI value"),
    ],
)
def test_orders_that_cannot_be_met_are_refused_and_leave_nothing(scene, changes, reason, tmp_path):
    path = tmp_path / changes.get("path", "swing.gif")
    with pytest.raises(FitError, match=reason):
        animate(changes.get("scene", scene), path, size=changes.get("size", SMALL))
    assert list(tmp_path.iterdir()) == []


def test_a_film_that_is_there_stays(scene, tmp_path):
    (tmp_path / "swing.gif").write_text("mine")
    with pytest.raises(OutputError):
        animate(scene, tmp_path / "swing.gif")
    assert (tmp_path / "swing.gif").read_text() == "mine"


def test_the_command_writes_a_gif(tmp_path):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    save_fit_result(tmp_path / "fit.json", a_fit())
    write_take(tmp_path / "swing.mcap", a_take())
    words = ("animate", ".", "--take", "swing.mcap", "--out", "a.gif", "--size", "160x120", "--spacing", "0.15")
    done = hangtime_here(*words, folder=tmp_path)
    assert done.stdout.strip() == "a.gif"
    assert (tmp_path / "a.gif").read_bytes().startswith(b"GIF89a")
    wrong = hangtime_here(*words[:6], "--size", "wide", folder=tmp_path)
    assert wrong.returncode == 2


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--motion", "twist", "--speed", "1.0"], "--speed: changes nothing here: only a computed walk has a speed"),
        (["--motion", "twist", "--height", "1.6"], "--height: changes nothing here: a figure has a height"),
        (["--bvh", "a.bvh", "--speed", "1.0"], "--speed: changes nothing here"),
        (["--seconds", "3"], "--seconds: changes nothing here: a take lasts as long as it does"),
        (["--motion", "dance"], "--motion: there is no motion named 'dance'"),
        (["--motion", "twist", "--seconds", "900"], "--seconds: 900 s is no length"),
        (["--figure", "dance"], "--figure: no figure moves by 'dance'"),
        (["--motion", "twist", "--wear", "t-shirt"], "--wear: changes nothing here: only a figure wears a garment"),
        (["--figure", "walk", "--wear", "t-shirt"], "--wear: changes nothing here: the take has a garment"),
        (["--figure", "walk", "--speed", "9"], "--speed: nobody walks at 9 m/s"),
        (["--motion", "twist", "--size", "63x64"], "--size: a film cannot have 63 x 64 pixels"),
        (["--motion", "twist", "--spacing", "-1"], "--spacing"),
        (["--motion", "twist", "--out", "a.glb", "--size", "64x64"], "--size: changes nothing here: a mesh has no pix"),
    ],
)
def test_options_are_checked_before_the_take_is_read(words, says, tmp_path):
    """The take does not exist, which is reported only where all options are valid."""
    save_fit_result(tmp_path / "fit.json", a_fit())
    order = ["animate", ".", "--take", "none.mcap", "--out", "new/a.gif", *words]
    done = hangtime_here(*order, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"hangtime: {says}")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fit.json"]


def test_a_film_of_another_garments_take_says_so(scene, tmp_path):
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    own = msgspec.structs.replace(a_fit(), garment="sheet", garment_content=content_of_garment(scene.take.garment))
    other = msgspec.structs.replace(own, garment="grey skirt", garment_content="ab")
    old = a_fit(density=2 * scene.take.garment.areal_density)
    said = [animate(dataclasses.replace(scene, result=fit), tmp_path / "a.glb", overwrite=True).remarks
            for fit in (own, other, old)]  # fmt: skip
    assert said[0] == ()
    assert "is of another garment (" in said[1][0]
    assert "than the fit (grey skirt)" in said[1][0]
    assert "is of another garment" in said[2][0]


@pytest.mark.slow
def test_layers_of_a_sewn_garment_stay_apart_in_a_film_and_would_cross_without():
    """Front and back start 2 cm apart, fall together, and pass through each other where nothing keeps them apart."""
    tube = msgspec.structs.replace(sheet(mass=0.08), format="hangtime-garment/2", seams=((1, 2), (3, 0)))
    time = np.arange(0, 1, 1 / 30)
    recording = prepare(take_of(tube, time, np.zeros((len(time), 3)), hung(tube, time)))
    least = {}
    for apart in (0.0, 2e-3):
        moving = motion_of(a_fit(), recording, 0.15, layers_apart=apart)
        inner = np.flatnonzero((np.abs(moving.rest[:, 0]) < 0.15) & (moving.rest[:, 1] < -0.1))
        front, back = inner[: len(inner) // 2], inner[len(inner) // 2 :]
        assert moving.rest[front] == pytest.approx(moving.rest[back])
        least[apart] = float((moving.places[:, back, 1] - moving.places[:, front, 1]).min())
    assert least[0.0] < 0.0 < least[2e-3]
