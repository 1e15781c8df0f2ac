"""Third-party simulators against closed-form mechanics, and their planted effects, in the real engines."""

from __future__ import annotations

import functools
import importlib.util
import json
import sys

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import least_squares
from scipy.special import j0

from fit.blind.cases import FILES, draw_truth, make_takes, plan
from fit.blind.engine import POLES, SAMPLES_A_SECOND, Cloth, Engine
from fit.blind.foreign.engines import ANYWHERE, GENERATORS, OUTSIDE, OWN_GENERATOR, WORKERS, find_generator
from fit.blind.foreign.jobs import make_job, points_on
from fit.blind.making import LABELS, MANIFEST, SEALED_KEY, make_set, open_labels
from fit.blind.plants import with_plants
from fit.blind.seal import load_key, seal, sha256_of, unseal
from fit.blind.sheet import make_grid
from fit.errors import BlowUpError, FitError
from fit.foreign.process import BLENDER, Foreign, ForeignProcess
from tests.fit.blind.test_blind_cases import guessed, planted
from tests.fit.blind.test_blind_engine import bar, nudged

GRAVITY = 9.80665
LENGTH = 0.3130
CHAIN = 1.2024 * np.sqrt(GRAVITY / LENGTH) / (2 * np.pi)  # Hz, 1.0712
is_installed = functools.cache(Foreign.is_installed)  # it starts a Python to see
FOREIGN = [generator for generator in GENERATORS if generator.foreign is not None]
MUJOCO, NEWTON = find_generator("mujoco"), find_generator("newton")


def with_engine(*generators):
    """The engines that a test is run with, each skipped with a reason where it is not installed."""
    return pytest.mark.parametrize(
        "generator",
        [
            pytest.param(
                g,
                id=g.name,
                marks=[
                    pytest.mark.skipif(
                        not is_installed(g.foreign),
                        reason=f"{g.foreign.module} is in neither this Python nor the one {g.foreign.variable} names",
                    ),
                ],
            )
            for g in generators
        ],
    )


def points_of(generator, cloth, ends, duration, places, side=0.04):
    return generator.points(cloth, ends, duration, np.array(places, float), side=side)[0]


def first_mode(sheet, points):
    """Course [m] of the first swing of a hanging sheet: J0 over the height, projected by mass."""
    shape = j0(2.404826 * np.sqrt(np.clip(1 + sheet.rest[:, 1] / sheet.height, 0, 1)))
    weights = shape * sheet.node_area
    return points[:, :, 1] @ weights / (shape @ weights)


def ringing(generator, damping, bending=1e-7):
    """Frequency [Hz] and decay [1/s] of the first swing after a nudge of 2 mm."""
    cloth = Cloth(width=0.1, height=LENGTH, bending=bending, damping=damping)
    sheet = make_grid(0.1, LENGTH, 0.02)
    moved = nudged(6.0) - [0.0, 0.002, 0.0]
    points = points_of(generator, cloth, bar(0.1, moved), 6.0, sheet.rest, side=0.02)
    course = first_mode(sheet, points)[round(0.3 * SAMPLES_A_SECOND) :]
    time = np.arange(len(course)) / SAMPLES_A_SECOND

    def left(p):
        return p[0] * np.exp(-p[1] * time) * np.cos(2 * np.pi * p[2] * time + p[3]) + p[4] - course

    found = least_squares(left, [0.003, damping / 2, CHAIN, 0.0, 0.0], x_scale=[1e-3, 0.1, 0.01, 0.1, 1e-4])
    return found.x[2], found.x[1]


@with_engine(*FOREIGN)
@pytest.mark.parametrize("damping", [0.0, 0.6])
@pytest.mark.slow
def test_a_hanging_sheet_rings_as_a_chain_does_and_decays_by_half_its_damping(generator, damping):
    """1.0712 Hz within 0.5 %; 0.3 1/s, or nothing at all, within 0.005 1/s: the engine adds no damping of its own."""
    hertz, decay = ringing(generator, damping)
    assert hertz == pytest.approx(CHAIN, rel=0.005)
    assert decay == pytest.approx(damping / 2, abs=0.005)


@pytest.mark.slow  # short steps: five seconds of a processor
@with_engine(*FOREIGN)
def test_a_sheet_as_stiff_as_a_board_swings_as_one(generator):
    """A plate hinged at its edge: sqrt(3 g / 2 L) / 2 pi = 1.0909 Hz, 1.9 % above the chain; B / rho g L^3 = 0.8."""
    hertz, _ = ringing(generator, 0.0, bending=0.05)
    assert hertz == pytest.approx(np.sqrt(1.5 * GRAVITY / LENGTH) / (2 * np.pi), rel=0.005)


@with_engine(*FOREIGN)
def test_a_hanging_sheet_stretches_under_its_own_weight(generator):
    """rho g L^2 / 2 k = 0.2 x 9.80665 x 0.09 / 400 = 0.4413 mm; the ground's contraction at the clamp takes some."""
    cloth = Cloth(width=0.15, height=0.3, stretch=200.0, shear=10.0)
    bottom = points_of(generator, cloth, bar(0.15, np.zeros((41, 3))), 0.2, [(0.0, -0.3)], side=0.02)
    assert -bottom[-1, 0, 2] - 0.3 == pytest.approx(0.4413e-3, rel=0.05)


@pytest.mark.slow
@with_engine(*FOREIGN)
@pytest.mark.parametrize("relaxation", [0.0, 3e-4])
def test_a_bouncing_sheet_loses_what_its_viscosity_takes(generator, relaxation):
    """Let go flat, it bounces at (pi / 2 L) sqrt(k / rho) = 202.8 rad/s and decays by tau omega^2 / 2 = 6.17 1/s.

    Where only the fibres are viscous (Newton's springs) nine tenths of it; nothing at all without.
    """
    cloth = Cloth(width=0.1, height=0.3, stretch=300.0, shear=10.0, damping=0.0, stretch_time=relaxation)
    engine = Engine(cloth, side=0.02, mesh=make_grid)
    job = make_job(engine, bar(0.1, np.zeros((161, 3))), 0.8, step=engine.stable_step, settle=0.0)
    process = ForeignProcess(generator.foreign)
    nodes = process.answer(**job.arrays)["nodes"][0].astype(float)
    process.close()
    shape = np.sin(-np.pi / 2 * job.sheet.rest[:, 1] / 0.3)
    weights = shape * job.sheet.node_area
    course = (nodes[:, :, 2] - job.sheet.rest[:, 1]) @ weights / (shape @ weights)
    time, omega = np.arange(161) / SAMPLES_A_SECOND, np.pi / 2 * np.sqrt(300 / 0.2) / 0.3
    decay = relaxation * omega**2 / 2

    def left(p):
        return p[0] * np.exp(-p[1] * time) * np.cos(p[2] * time + p[3]) + p[4] - course

    found = least_squares(left, [3e-4, decay, omega, 0.0, -3e-4], x_scale=[1e-4, 1, 10, 0.1, 1e-4]).x
    assert found[2] == pytest.approx(omega, rel=0.01)
    assert found[1] == pytest.approx(decay, rel=0.12, abs=0.02)


@with_engine(*FOREIGN)
def test_the_held_edge_is_where_it_is_driven(generator):
    moved = nudged(1.0, size=0.05)
    held = points_of(generator, Cloth(width=0.2, height=0.3), bar(0.2, moved), 1.0, [(-0.1, 0.0), (0.1, 0.0)])
    assert np.abs(held - (bar(0.2, moved)[0].reshape(-1, 2, 3))).max() < 1e-6


@with_engine(*FOREIGN)
def test_tilted_gravity_tilts_the_hanging_sheet(generator):
    """0.05 rad about the vertical: the bottom hangs sin(0.05) x 0.3 m = 15.0 mm aside."""
    cloth = Cloth(width=0.2, height=0.3, gravity_tilt=(0.0, 0.05))
    bottom = points_of(generator, cloth, bar(0.2, np.zeros((41, 3))), 0.2, [(0.0, -0.3)])
    assert bottom[-1, 0, 1] == pytest.approx(0.3 * np.sin(0.05), rel=0.02)


@pytest.mark.slow
@with_engine(*FOREIGN)
def test_a_draught_tilts_the_sheet_as_the_plates_law_says(generator):
    """Rigid plate in 0.5 m/s face-on: 0.5 x 1.2041 x 1.2 x 0.25 Pa against 0.2 x 9.80665 Pa: tan a = 0.092.

    A chain under an even side load hangs straight, so that the middle hangs as the bottom does; gusts start at 0.
    """
    cloth = Cloth(width=0.2, height=0.3, wind=(0.0, 0.5, 0.0), gust_phase=0.0)
    bottom = points_of(generator, cloth, bar(0.2, np.zeros((41, 3))), 0.2, [(0.0, -0.3)])
    lean = bottom[0, 0, 1] / -bottom[0, 0, 2]
    # the blown plate's force is square to the sheet, its coefficient hardly less than face-on
    assert lean == pytest.approx(0.092, rel=0.06)


def swung_with(generator, *plants):
    """Six points of a swung sheet with what is planted."""
    time = np.arange(241) / SAMPLES_A_SECOND
    moved = np.zeros((241, 3))
    moved[:, 1] = 0.06 * np.sin(2 * np.pi * 1.0 * time) * np.clip(time / 0.4, 0, 1) ** 3
    places = [(x, y) for x in (-0.1, 0.0, 0.1) for y in (-0.15, -0.3)]
    cloth = with_plants(Cloth(width=0.2, height=0.3), plants)
    return points_of(generator, cloth, bar(0.2, moved), 1.2, places)


@functools.cache
def swung_without(name):
    """The same of an engine's plain sheet."""
    return swung_with(find_generator(name))


@pytest.mark.slow
@with_engine(*FOREIGN)
@pytest.mark.parametrize(
    ("one", "least"),
    [
        (planted("air_drag", 1.2), 2e-3),
        (planted("air_lift", 2.0), 2e-4),
        (planted("hem", 0.01), 1e-3),
        (planted("mass_distribution", 0.3, across=0.0, down=0.3), 5e-4),
        (planted("anisotropy", 1.4, stretch=1.0, bending=1.0), 5e-5),
        (planted("wake_memory", 0.8), 2e-3),
        (planted("corner_pendulum", 0.1), 5e-4),
        (planted("loose_thread", 0.5), 2e-3),
        (planted("hidden_magnet", 0.05), 1e-3),
    ],
)
def test_a_planted_effect_moves_the_cloth(generator, one, least):
    """Points of a swung sheet with and without differ by more than the least [m] that a plant of this size does."""
    assert np.abs(swung_with(generator, one) - swung_without(generator.name)).max() > least


@pytest.mark.slow
@with_engine(*FOREIGN)
def test_a_null_moves_as_the_own_generators_does(generator):
    """Other triangles, other membrane, other bending: on meshes of 30 mm a null's takes agree to 8 % of their swing.

    The own generator's 30 mm against its 16 mm differ by 2 to 6 %.
    """
    truth = draw_truth("case", "null", (), (3, 0))
    truth = replace(truth, look=replace(truth.look, noise=1e-9, away=0.0, grid=0, duration=3.2))
    own, theirs = make_takes(truth, side=0.03), make_takes(truth, side=0.03, generator=generator)
    for one, other in zip(own, theirs, strict=True):
        swung = (one.points - one.held.mean(1, keepdims=True))[:, 2:4]
        swung = np.sqrt(((swung - swung.mean(0)) ** 2).sum(2).mean())
        apart = np.sqrt(((one.points - other.points) ** 2).sum(2).mean())
        assert apart < 0.08 * swung


@with_engine(*FOREIGN)
@pytest.mark.slow
def test_nothing_public_says_whose_cloth_it_was(generator, tmp_path):
    make_set(tmp_path / "set", {"single": 0, "null": 1, "pair": 0, "unknown": 0}, generator.plants([]), 2, side=0.1,
             generator=generator)  # fmt: skip
    public = [path for path in (tmp_path / "set").rglob("*") if path.is_file() and path.parent.name != "sealed"]
    assert len(public) == 1 + len(FILES)
    for path in public:
        assert generator.name.encode() not in path.read_bytes().lower()
    assert open_labels(tmp_path / "set").generator == generator.name


def test_appearances_do_not_reveal_the_label_whoever_makes_the_cloth():
    """Nearest centroid, two classes of 240: chance is 50 %, its deviation 2.3 %; 58 % would be 3.5 of them."""
    for generator in FOREIGN:
        numbers = {"single": 240, "null": 240, "pair": 0, "unknown": 0}
        truths = plan(numbers, generator.plants([]), 17, generator.unknown_plants())
        features = np.array([[*t.look.features(), k, int(t.id, 16)] for k, t in enumerate(truths)])
        features = (features - features.mean(0)) / features.std(0)
        assert guessed(features, np.array([t.kind == "null" for t in truths])) < 0.58


def outside(**numbers):
    """Forces on one square metre facing y, of two triangles; the program's module is NumPy only."""
    spec = importlib.util.spec_from_file_location("outside_forces", WORKERS / "outside_forces.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    engine = Engine(Cloth(width=1.0, height=1.0), side=0.5, mesh=make_grid)
    start = np.array([(x, 0.0, z) for x, z in [(0, 0), (1, 0), (0, -1), (1, -1)]], float)
    poles = dict.fromkeys(POLES, 0.0)
    known = {**engine.numbers(), **poles, "bob_node": 3.0, "thread_node": 3.0, **numbers}
    return module.OutsideForces(known, np.array([[0, 2, 1], [1, 2, 3]]), np.array([0, 0, 0, 1.0]), start, 1e-3), start


def test_drag_on_a_square_metre_face_on_is_half_rho_c_v2():
    """1.2 x 0.5 x 1.2041 x 4 = 2.890 N against 2 m/s."""
    forces, x = outside(drag=1.2)
    total = forces.at(0.0, x, np.tile([0.0, 2.0, 0.0], (4, 1))).sum(0)
    assert total == pytest.approx([0.0, -2.890, 0.0], abs=1e-3)


def test_a_wake_pulls_only_until_it_has_caught_up():
    """0.8 N s/m^3 on 1 m^2 at 2 m/s: 1.6 N at first, 1.6 / e after the wake's 0.4 s."""
    forces, x = outside(wake=0.8, wake_time=0.4)
    v = np.tile([0.0, 2.0, 0.0], (4, 1))
    pulls = [-forces.at(0.0, x, v).sum(0)[1] for _ in range(401)]
    assert pulls[0] == pytest.approx(1.6, rel=0.01)
    assert pulls[400] == pytest.approx(1.6 / np.e, rel=0.01)


def test_a_thread_pulls_one_way_and_a_bob_hangs_by_its_weight():
    forces, x = outside(thread=0.5, thread_x=1.3, thread_y=0.0, thread_z=-1.0, thread_length=0.1)
    assert forces.at(0.0, x, 0 * x)[3] == pytest.approx([0.5 * 0.2, 0.0, 0.0], abs=1e-6)
    forces, x = outside(thread=0.5, thread_x=1.05, thread_y=0.0, thread_z=-1.0, thread_length=0.1)
    assert not forces.at(0.0, x, 0 * x).any()
    forces, x = outside(bob_mass=0.01, bob_length=0.06)
    pulls = [forces.at(0.0, x, 0 * x)[3, 2] for _ in range(20000)]
    assert np.mean(pulls) == pytest.approx(-0.01 * GRAVITY, rel=0.02)  # it bounces on its string about its weight


def test_nothing_acts_from_outside_on_a_null():
    assert not outside()[0].are_there


def test_every_generator_says_what_it_can_plant_and_refuses_the_rest():
    for generator in FOREIGN:
        assert set(ANYWHERE) <= set(generator.effects) <= set(OWN_GENERATOR.effects)
        assert generator.unknown_plants()
        assert {p.id for p in generator.plants([])} == set(generator.effects)
    assert set(OUTSIDE) <= set(MUJOCO.effects) & set(NEWTON.effects)
    with pytest.raises(FitError, match="'added_mass' can be planted with the generator mujoco; known: air_drag"):
        MUJOCO.plants(["added_mass"])
    with pytest.raises(FitError, match="no generator named 'maya'; known: own, mujoco"):
        find_generator("maya")


def test_an_engine_that_is_not_there_is_named_before_anything_is_written(monkeypatch, tmp_path):
    monkeypatch.setenv(MUJOCO.foreign.variable, str(tmp_path / "nowhere"))
    numbers = {"single": 0, "null": 1, "pair": 0, "unknown": 0}
    with pytest.raises(
        FitError, match=r"mujoco cannot be started; in Hangtime's checkout: pip install -e '.\[mujoco\]'"
    ):
        make_set(tmp_path / "set", numbers, MUJOCO.plants([]), 1, generator=MUJOCO)
    assert not (tmp_path / "set").exists()


@with_engine(MUJOCO)
def test_cloth_that_flies_apart_is_reported_and_does_not_begin_anew(generator):
    """With twice its step; MuJoCo by itself would hang it up flat again, a metre off at most, and go on."""
    cloth = Cloth(width=0.1, height=LENGTH)
    with pytest.raises(BlowUpError, match="cloth flew apart"):
        generator.points(cloth, bar(0.1, nudged(0.3)), 0.3, np.array([(0.0, -0.1)]), side=0.04, share=2.0)


def test_a_program_that_ends_in_the_middle_is_reported_with_its_last_words(tmp_path):
    script = tmp_path / "dies.py"
    script.write_text("import sys\nprint('ready 1', flush=True)\ninput()\nprint('no memory', file=sys.stderr)\n")
    process = ForeignProcess(Foreign("Thing", "json", "thing", "HANGTIME_THING_PYTHON", script))
    with pytest.raises(FitError, match="no memory: Thing ended in the middle of a simulation"):
        process.answer(job=np.zeros(1))
    process.close()


def test_arrays_go_to_another_python_and_come_back(tmp_path):
    script = tmp_path / "doubles.py"
    script.write_text(
        "from answering import answer_jobs\n"
        "def double(job):\n    print('chatter')\n    return {'twice': 2 * job['x']}\nanswer_jobs('7', double)\n"
    )
    process = ForeignProcess(Foreign("Thing", "json", "thing", "HANGTIME_THING_PYTHON", script))
    assert process.version == "7"
    assert process.answer(x=np.arange(3.0))["twice"] == pytest.approx([0, 2, 4])
    assert process.answer(x=np.ones(2))["twice"] == pytest.approx([2, 2])
    process.close()


def test_files_that_a_simulator_writes_to_its_working_folder_are_removed(monkeypatch, tmp_path):
    """And a Python that is named from here is found from there."""
    script, here = tmp_path / "writes.py", tmp_path / "here"
    script.write_text(
        "open('WRITTEN', 'w').close()\nfrom answering import answer_jobs\nanswer_jobs('7', lambda job: job)\n"
    )
    here.mkdir()
    (here / "python").symlink_to(sys.executable)
    monkeypatch.chdir(here)
    monkeypatch.setenv("HANGTIME_THING_PYTHON", "./python")
    process = ForeignProcess(Foreign("Thing", "json", "thing", "HANGTIME_THING_PYTHON", script))
    process.close()
    assert [p.name for p in here.iterdir()] == ["python"]


def test_a_grid_covers_its_sheet_with_triangles_of_the_same_size():
    sheet = make_grid(0.3, 0.4, 0.05)
    assert sheet.area == pytest.approx(np.full(96, 0.05**2 / 2))
    assert sheet.node_area.sum() == pytest.approx(0.12)
    assert len(sheet.held) == 7
    corners = np.cross(*(np.pad(sheet.rest[sheet.triangles[:, k]] - sheet.rest[sheet.triangles[:, 0]], ((0, 0), (0, 1)))
                         for k in (1, 2)))  # fmt: skip
    assert (corners[:, 2] > 0).all()


def test_a_job_holds_the_weight_the_path_and_the_take():
    """At rate 200 and a largest step of 1/700 s, four steps a sample; a hem moves mass and adds none."""
    engine = Engine(with_plants(Cloth(width=0.2, height=0.3), (planted("hem", 0.01),)), side=0.05, mesh=make_grid)
    job = make_job(engine, bar(0.2, nudged(1.0)), 1.0, step=1 / 700)
    assert int(job.arrays["every"]) == 4
    assert float(job.arrays["dt"]) == pytest.approx(1 / 800)
    assert job.arrays["path"].shape == (1, 801, 6)
    assert job.arrays["mass"].sum() == pytest.approx(0.2 * 0.06)
    nodes = job.arrays["start"][:, None]
    place = points_on(job.sheet, nodes, np.array([(0.03, -0.12)]))
    assert place[0, 0, 0] == pytest.approx([0.03, 0.0, -0.12])


def test_labels_keep_who_made_the_set_and_old_labels_read_as_own(tmp_path):
    numbers = {"single": 0, "null": 1, "pair": 0, "unknown": 0}
    make_set(tmp_path / "set", numbers, OWN_GENERATOR.plants([]), 1, side=0.1)
    labels = open_labels(tmp_path / "set")
    assert labels.generator == "own"
    path, key = tmp_path / "set" / LABELS, load_key(tmp_path / "set" / SEALED_KEY)
    raw = json.loads(unseal(path.read_bytes(), key, where=path))
    assert raw.pop("generator") == "own"
    path.write_bytes(seal(json.dumps(raw).encode(), key))
    manifest = json.loads((tmp_path / "set" / MANIFEST).read_text())
    (tmp_path / "set" / MANIFEST).write_text(json.dumps({**manifest, "sealed": sha256_of(path)}))
    assert open_labels(tmp_path / "set") == labels
    with pytest.raises(FitError, match="another set of cases"):
        make_set(tmp_path / "set", numbers, OWN_GENERATOR.plants([]), 1, side=0.05)


def test_blenders_program_is_the_one_that_fits_use():
    assert BLENDER.script.exists()
    assert all(generator.foreign.script.exists() for generator in FOREIGN)
