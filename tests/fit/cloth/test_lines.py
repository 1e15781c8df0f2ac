"""Fibres, shear and bends evaluated by lines equal those by stencils."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.cloth import lines
from fit.cloth.mesh import build_mesh
from tests.fit.scenes import sheet

FLARED = ((-0.2, 0.0), (0.2, 0.0), (0.3, -0.45), (-0.25, -0.4))


def from_both_ends(y):
    """Differences and sums of a line's outer and of its inner nodes; y, (..., 4)."""
    return y[..., 3] - y[..., 0], y[..., 2] - y[..., 1], y[..., 0] + y[..., 3], y[..., 1] + y[..., 2]


def by_slopes(w, y):
    """The three samples of `fit.cloth.lines` by its five weights, (..., 5)."""
    outer, inner, rim, core = from_both_ends(y)
    w = np.moveaxis(w, -1, 0)
    even, odd = w[2] * outer + w[3] * inner, w[4] * (rim - core)
    return np.stack([even - odd, w[0] * outer + w[1] * inner, even + odd], -1)


@pytest.fixture
def mesh():
    return build_mesh(sheet(), 0.05)


@pytest.mark.parametrize("family", [0, 1])
def test_slopes_along_lines_are_those_of_the_stencils(mesh, family):
    field = np.random.default_rng(1).standard_normal(len(mesh.rest))
    count, nodes, weights = lines.fibre_family(mesh, family)
    assert count == lines.IN_LINES
    found = by_slopes(weights.reshape(-1, lines.LINE_ENTRIES), field[nodes.reshape(-1, lines.LINE_ENTRIES)[:, :4]])
    expected = mesh.fibres.stencils.apply(field)
    expected = expected[: mesh.fibres_across] if family == 0 else expected[mesh.fibres_across :]
    assert found.ravel() == pytest.approx(expected, rel=1e-5, abs=1e-4)  # slopes reach 200; single precision


def test_values_and_twists_are_those_of_the_mesh(mesh):
    """Element by element: samples of one position across, from one end to the other."""
    slopes = np.random.default_rng(2).standard_normal(len(mesh.fibres.area))
    y = slopes[mesh.shear_across.reshape(-1, 3, 4)]
    assert (y == y[:, :1]).all()
    outer, inner, rim, core = from_both_ends(y[:, 0])
    w = lines.VALUES
    even, odd = w[2] * rim + w[3] * core, w[4] * outer + w[5] * inner
    found = np.stack([even - odd, w[0] * rim + w[1] * core, even + odd], -1)
    assert found.ravel() == pytest.approx(np.einsum("sk,sk->s", mesh.shear_weights[:, :4], slopes[mesh.shear_across]))
    between = lines.BETWEEN.reshape(3, 4)[np.arange(len(mesh.shear_area)) // 3 % 3]
    assert mesh.shear_weights[:, 4:] == pytest.approx(between, rel=1e-6)
    twists = by_slopes(np.array(lines.UNIT_SLOPES), y[:, 0]).ravel() * lines.twist_scales(mesh)
    expected = np.einsum("sk,sk->s", mesh.bends.twist_weights, slopes[mesh.shear_across])
    assert twists == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_pairs_of_bends_are_those_of_the_stencils(mesh):
    field = np.random.default_rng(3).standard_normal(len(mesh.rest))
    lengths, weights = lines.bends_by_line(mesh)
    assert lengths == (lines.IN_LINES, 7)
    count = 4 * mesh.bends.counts[0]
    pairs = mesh.bends.stencils.nodes[:count].reshape(-1, 2, 4)
    outer, inner, rim, core = from_both_ends(field[pairs[:, 0]])
    w = lines.CURVATURES
    even, odd = w[0] * (rim - core), w[1] * outer + w[2] * inner
    found = np.stack([even - odd, even + odd], -1) * weights[:count].reshape(-1, 2, 4)[:, :, 0]
    expected = mesh.bends.stencils.apply(field)[: mesh.bends.counts[0]]
    assert found.ravel() == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_where_threads_cross_the_mesh_every_sample_keeps_its_own_nodes():
    askew = build_mesh(msgspec.structs.replace(sheet(), grain_degrees=20.0), 0.05)
    assert [lines.fibre_family(askew, k)[0] for k in range(2)] == [16, 16]
    flared = build_mesh(msgspec.structs.replace(sheet(), outline_m=FLARED), 0.06)
    for k in range(2):
        count, nodes, weights = lines.fibre_family(flared, k)
        assert count in (lines.IN_LINES, 16)
        assert len(nodes) == len(weights)


@pytest.mark.parametrize(("off", "is_same"), [(2e-7, True), (5e-6, False)])
def test_lines_count_as_uniform_within_rounding(mesh, off, is_same):
    """The second weight of one sample is off by 2e-7, as after rounding, or by 5e-6."""

    def changed(stencils, row):
        weights = stencils.weights.copy()
        weights[stencils.first[row] + 1] *= 1 + off
        return dataclasses.replace(stencils, weights=weights)

    fibres = dataclasses.replace(mesh.fibres, stencils=changed(mesh.fibres.stencils, 4))
    bends = dataclasses.replace(mesh.bends, stencils=changed(mesh.bends.stencils, 3))
    other = dataclasses.replace(mesh, fibres=fibres, bends=bends)
    assert (lines.fibre_family(other, 0)[0] == lines.IN_LINES) == is_same
    assert lines.fibre_family(other, 1)[0] == lines.IN_LINES
    assert (lines.bends_by_line(other)[0] == lines.bends_by_line(mesh)[0]) == is_same
    assert lines.bends_by_line(other)[0][0] == (lines.IN_LINES if is_same else 4)


def test_a_twisted_sheet_stores_twice_its_mixed_curvature_squared(mesh):
    """z = a x y with a = 3 1/m on 0.4 m x 0.45 m: the mixed derivatives squared add up to 2 a^2 x 0.18 m^2 = 3.24."""
    fibres, at, weights = mesh.fibres.stencils, mesh.shear_across, mesh.bends.twist_weights
    slopes = fibres.apply(3.0 * mesh.rest[:, :1] * mesh.rest[:, 1:])[:, 0]
    assert ((slopes[at] * weights).sum(1) ** 2).sum() == pytest.approx(3.24, rel=1e-9)
