"""The stable time step, against hand calculation and dense eigenvalues."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.clamps import steps_of
from fit.cloth import material as mat
from fit.cloth.contact import CONTACT_DAMPING, CONTACT_OMEGA, Contact, contact_rate
from fit.cloth.effect import amplitudes_of
from fit.cloth.mesh import build_mesh
from fit.cloth.model import SAFETY, ClothModel, Resolution
from fit.cloth.stability import unit_frequencies
from fit.effects import find_effects
from fit.recordings.bodies import half_space
from fit.recordings.recording import prepare
from tests.fit.scenes import as_rows, sheet, take_of

EFFECTS = find_effects(["hem", "bending_hysteresis", "self_contact"])
MEMBRANE = {"shear_stiffness": 1e-6, "bending_stiffness": 1e-12, "membrane_damping_time": 0.0}
PLATE = {"stretch_stiffness": 1e-6, "shear_stiffness": 1e-6, "bending_damping_time": 0.0, "bending_stiffness": 1e-2}


@pytest.fixture(scope="module")
def model():
    """A sheet of six elements, 0.2 kg/m^2."""
    still = prepare(take_of(sheet(), np.arange(20) / 30, np.zeros((20, 3))))
    return ClothModel(still, EFFECTS, resolution=Resolution(spacing=0.06))


def step(model, base, effects=None, **changes):
    """The stable step of a material with changes."""
    row = as_rows([mat.Material(**(base | changes))])
    return float(model.stable_steps(row, amplitudes_of(EFFECTS, **(effects or {}))[None])[0])


def largest(weights):
    return float(np.linalg.eigvalsh(weights.T @ weights)[-1])


def dense(stencils, nodes, kind=0):
    """The stencils as a matrix, (stencils, nodes)."""
    matrix = np.zeros((len(stencils), nodes))
    np.add.at(matrix, (stencils.rows(), stencils.nodes), stencils.weights[:, kind])
    return matrix


def test_the_bounds_are_the_largest_eigenvalues_of_each_energy_alone():
    """A sheet that is not square, so that its two families of threads differ: by more than a third here."""
    mesh = build_mesh(sheet(width=0.3, height=0.45), 0.06)
    nodes = len(mesh.rest)
    by_mass = 1 / np.sqrt(mesh.node_area)
    fibres = dense(mesh.fibres.stencils, nodes) * by_mass
    stretched = np.sqrt(mesh.fibres.area)[:, None] * fibres
    families = [largest(stretched[: mesh.fibres_across]), largest(stretched[mesh.fibres_across :])]
    weights, samples = mesh.shear_weights, np.arange(len(mesh.shear_area))
    sheared = np.zeros((2, len(samples), len(fibres)))
    for k in range(4):
        np.add.at(sheared[0], (samples, mesh.shear_across[:, k]), weights[:, k])
        np.add.at(sheared[1], (samples, mesh.shear_down[:, k]), weights[:, 4 + k])
    root = np.sqrt(mesh.shear_area)[:, None]
    slopes = np.hstack([root * (sheared[1] @ fibres), root * (sheared[0] @ fibres)])
    twisted = np.zeros((len(samples), len(fibres)))
    for k in range(4):
        np.add.at(twisted, (samples, mesh.shear_across[:, k]), mesh.bends.twist_weights[:, k])
    bent = np.vstack([dense(mesh.bends.stencils, nodes) * by_mass, twisted @ fibres])
    assert max(families) > 1.02 * min(families)
    expected = [max(families), largest(slopes), largest(bent)]
    assert unit_frequencies(mesh) == pytest.approx(expected, rel=2e-3)  # sought to 1e-3


def test_an_undamped_membrane_takes_a_step_of_safety_times_two_over_omega(model):
    """omega^2 = k lambda / rho."""
    by_stretch = unit_frequencies(model.mesh)[0]
    omega = np.sqrt(300.0 * by_stretch / 0.2)
    assert step(model, MEMBRANE) == pytest.approx(SAFETY * 2 / omega, rel=1e-3)


@pytest.mark.parametrize(
    ("base", "changes", "ratio"),
    [
        (MEMBRANE, {"areal_density": 0.8}, 2.0),
        (MEMBRANE, {"stretch_stiffness": 1200.0}, 1 / 2),
        (MEMBRANE, {"stretch_ratio": -1.0}, np.exp(-1 / 4)),  # the stiffer family is e^(1/2) times as stiff
        (MEMBRANE, {"stiffening": 60.0}, 1 / 2),  # 1 + 0.05 x 60 = 4 times as stiff at 5 % of strain
        (MEMBRANE, {"viscosity_time": 6e-3}, 1 / 2),  # 1 + 6 ms / 2 ms = 4
        (PLATE, {"bending_stiffness": 4e-2}, 1 / 2),
        (PLATE, {"bending_ratio": 1.0}, np.exp(-1 / 4)),
    ],
)
def test_an_effect_that_makes_cloth_stiffer_or_heavier_changes_the_step_by_its_root(model, base, changes, ratio):
    # 2e-3: what is left of shear and, of the plate, of stretch
    assert step(model, base, **changes) == pytest.approx(ratio * step(model, base), rel=2e-3)


@pytest.mark.parametrize(("base", "name"), [(MEMBRANE, "membrane_damping_time"), (PLATE, "bending_damping_time")])
def test_damping_shortens_the_step(model, base, name):
    """zeta = omega tau / 2 = 3/4: sqrt(1 + 9/16) - 3/4 = 1/2."""
    omega = SAFETY * 2 / step(model, base)
    assert step(model, base, **{name: 1.5 / omega}) == pytest.approx(step(model, base) / 2, rel=2e-3)


def test_a_hem_takes_mass_from_the_rest_and_so_shortens_the_step(model):
    """45 g/m on 0.4 m are half of 36 g: elsewhere the cloth is half as heavy."""
    assert step(model, MEMBRANE, {"hem": 0.045}) == pytest.approx(step(model, MEMBRANE) / np.sqrt(2), rel=2e-3)


def test_friction_in_bending_counts_as_its_moment_over_five_per_metre(model):
    """0.15 N over 5 1/m is 0.03 N m beside 0.01: four times as stiff."""
    stiff = step(model, PLATE, {"bending_hysteresis": 0.15})
    assert stiff == pytest.approx(step(model, PLATE) / 2, rel=2e-3)


def test_contact_adds_what_two_layers_and_a_body_may_add(model):
    """omega^2 + 3 Omega^2 times the largest eigenvalue, with its own damping."""
    floor = Contact(bodies=(half_space((0.0, 0.0, -9.0), (0.0, 0.0, 1.0)),))
    on_floor = ClothModel(model.recording, EFFECTS, resolution=model.resolution, contact=floor)
    omega2 = (SAFETY * 2 / step(model, MEMBRANE)) ** 2
    for count, chosen, effects in (
        (2, model, {"self_contact": 0.005}),
        (1, on_floor, {}),
        (3, on_floor, {"self_contact": 0.005}),
    ):
        added = count * CONTACT_OMEGA**2 * chosen.surface.rate
        assert contact_rate(chosen.surface, is_layered=count > 1, has_bodies=count != 2) == pytest.approx(added)
        omega = np.sqrt(omega2 + added)
        zeta = added * 2 * CONTACT_DAMPING / CONTACT_OMEGA / (2 * omega)
        expected = SAFETY * 2 / omega * (np.sqrt(1 + zeta**2) - zeta)
        assert step(chosen, MEMBRANE, effects) == pytest.approx(expected, rel=2e-3)


def test_a_group_takes_the_longest_step_on_the_ladder_of_half_octaves_that_is_stable(model):
    """1 ms over sqrt(2)^n."""
    rows = np.concatenate([as_rows([mat.Material(stretch_stiffness=k)]) for k in (500.0, 5e3, 5e4)])
    stable, taken = model.stable_steps(rows, np.zeros((3, 3))), steps_of(model, rows)
    assert (taken <= stable).all()
    assert (taken * np.sqrt(2) > stable).all()
    assert np.log2(1e-3 / taken) * 2 == pytest.approx(np.round(np.log2(1e-3 / taken) * 2), abs=1e-9)
    finer = ClothModel(model.recording, EFFECTS, resolution=dataclasses.replace(model.resolution, step_share=0.5))
    assert finer.step(3) == pytest.approx(model.step(3) / 2)
