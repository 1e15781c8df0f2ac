"""The evidence of subsets of effects, against numerical integrals and linear models of known truth."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from fit.gap.likelihood import Sums
from fit.gap.subsets import CHANCE, SIZES, Columns, log_evidence, log_prior, log_share, reduced, subsets, summed_out

NUMBERS, PARAMETERS = 40, 3
PRECISION, OFFSET = np.array([0.5, 1.0, 5.0]), np.array([0.3, -0.2, 0.1])


def sums_of(rows):
    """Products under white noise: one scale, without a discrepancy."""
    return Sums((rows @ rows.T)[None], np.zeros(1))


def by_brute_force(residual, jacobian, signatures, ends, points=161):
    """Log evidence by a sum over a grid of amplitudes; base parameters are integrated as covariance."""
    covariance = np.eye(NUMBERS) + jacobian.T @ np.diag(1 / PRECISION) @ jacobian
    noise = multivariate_normal(-(-OFFSET @ jacobian), covariance)
    cells = [np.linspace(max(low, -5 * SIZES), min(high, 5 * SIZES), points + 1) for low, high in ends]
    axes = [(edges[1:] + edges[:-1]) / 2 for edges in cells]
    grid = np.array(list(itertools.product(*axes)))
    prior = -0.5 * (grid**2).sum(1) / SIZES**2
    likelihood = noise.logpdf(residual + grid @ signatures)
    return logsumexp(prior + likelihood) - logsumexp(prior) + 0.5 * NUMBERS * np.log(2 * np.pi)


@pytest.mark.parametrize("is_one_sided", [False, True])
def test_one_effect_has_the_evidence_of_an_integral_over_its_sizes(is_one_sided):
    rng = np.random.default_rng(1)
    jacobian, signature = rng.normal(size=(PARAMETERS, NUMBERS)), 0.3 * rng.normal(size=(1, NUMBERS))
    ends = [(0.0, 3.0) if is_one_sided else (-np.inf, np.inf)]
    columns = Columns(("one",), *(np.array([end[k] for end in ends]) for k in (0, 1)))
    for size in (-1.0, 0.0, 1.5):
        residual = rng.normal(size=NUMBERS) - size * signature[0]
        found = reduced(sums_of(np.vstack([residual, jacobian, signature])), PRECISION, OFFSET)
        got = log_evidence(found, columns, [("one",), ()])[:, 0]
        expected = by_brute_force(residual, jacobian, signature, ends)
        none = by_brute_force(residual, jacobian, np.zeros((1, NUMBERS)), ends)
        assert got[0] == pytest.approx(expected, abs=0.02)
        assert got[1] == pytest.approx(none, abs=1e-6)


def test_two_collinear_effects_have_the_evidence_of_an_integral_over_both_sizes():
    rng = np.random.default_rng(2)
    jacobian = rng.normal(size=(PARAMETERS, NUMBERS))
    first = 0.25 * rng.normal(size=NUMBERS)
    signatures = np.stack([first, 0.95 * first + 0.08 * rng.normal(size=NUMBERS)])
    columns = Columns(("one", "other"), np.array([0.0, 0.0]), np.array([6.0, 6.0]))
    for sizes in ((1.0, 1.0), (2.0, 0.0), (0.0, 0.0)):
        residual = rng.normal(size=NUMBERS) - np.array(sizes) @ signatures
        found = reduced(sums_of(np.vstack([residual, jacobian, signatures])), PRECISION, OFFSET)
        got = float(log_evidence(found, columns, [("one", "other")])[0, 0])
        # The shares of two truncated components one after another are an approximation.
        assert got == pytest.approx(by_brute_force(residual, jacobian, signatures, [(0.0, 6.0)] * 2), abs=0.2)


def test_shares_within_ranges_are_those_of_the_normal_distribution():
    low, high = np.array([0.0, -1.0]), np.array([np.inf, 0.5])
    mean, covariance = np.array([0.4, -0.2]), np.array([[1.0, 0.3], [0.3, 0.5]])
    drawn = multivariate_normal(mean, covariance).rvs(400_000, random_state=3)
    expected = np.mean(((drawn >= low) & (drawn <= high)).all(1))
    got = float(np.exp(log_share(mean[None], covariance[None], low, high)[0]))
    assert got == pytest.approx(expected, rel=0.01)
    far = log_share(np.array([[-40.0]]), np.eye(1)[None], np.zeros(1), np.array([np.inf]))[0]
    assert far == pytest.approx(-0.5 * 40.0**2 - np.log(40.0 * np.sqrt(2 * np.pi)), abs=0.01)


def test_every_subset_of_up_to_three_of_two_dozen_effects_is_weighed():
    names = [f"effect {n}" for n in range(24)]
    assert len(subsets(names)) == 1 + 24 + 276 + 2024
    alone = subsets(names, beside={name: name != names[0] for name in names})
    assert (names[0],) in alone
    assert not any(names[0] in one for one in alone if len(one) > 1)


class World:
    """A linear world of eight effects, two of them twins, whose truth is drawn from the prior."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.jacobian = rng.normal(size=(PARAMETERS, NUMBERS))
        self.signatures = 0.35 * rng.normal(size=(8, NUMBERS))
        self.signatures[1] = 0.9 * self.signatures[0] + 0.44 * self.signatures[1]
        self.names = tuple("abcdefgh")
        self.columns = Columns(self.names, np.where(np.arange(8) % 2, -np.inf, 0.0), np.full(8, np.inf))
        self.every = subsets(self.names)
        self.prior = np.array([log_prior(len(one)) for one in self.every])

    def posterior(self, residual):
        rows = np.vstack([residual, self.jacobian, self.signatures])
        found = reduced(sums_of(rows), PRECISION, OFFSET)
        log_mass = log_evidence(found, self.columns, self.every)[:, 0] + self.prior
        return np.exp(log_mass - logsumexp(log_mass))

    def residual(self, rng, amplitudes):
        moved = (rng.normal(size=PARAMETERS) / np.sqrt(PRECISION) - OFFSET) @ self.jacobian
        return rng.normal(size=NUMBERS) - moved - amplitudes @ self.signatures

    def drawn(self, rng):
        """Truth of the prior, and a residual of it."""
        share = np.exp(self.prior - logsumexp(self.prior))
        truth = self.every[rng.choice(len(self.every), p=share)]
        amplitudes = np.where([name in truth for name in self.names], SIZES * rng.normal(size=8), 0.0)
        amplitudes = np.where(self.columns.low == 0.0, np.abs(amplitudes), amplitudes)
        return truth, self.residual(rng, amplitudes)


@pytest.mark.slow
def test_probabilities_of_drawn_worlds_come_true_as_often_as_they_say():
    world, rng = World(4), np.random.default_rng(5)
    given, came_true = [], []
    for _ in range(600):
        truth, residual = world.drawn(rng)
        mass = world.posterior(residual)
        given += [
            float(sum(m for m, one in zip(mass, world.every, strict=True) if name in one)) for name in world.names
        ]
        came_true += [name in truth for name in world.names]
    given, came_true = np.array(given), np.array(came_true)
    bins = np.digitize(given, [0.1, 0.3, 0.5, 0.7, 0.9])
    apart = [abs(given[bins == k].mean() - came_true[bins == k].mean()) * np.mean(bins == k) for k in np.unique(bins)]
    assert sum(apart) < 0.02  # expected calibration error; sampling alone makes about 0.005
    assert came_true[given > 0.9].mean() > 0.93
    assert CHANCE / 8 < came_true[given < 0.1].mean() < 0.02


@pytest.mark.parametrize(("detectable", "least", "most"), [(0.5, 0.0, 0.15), (2.0, 0.6, 0.95), (4.0, 0.95, 1.0)])
def test_pairs_are_found_as_often_as_the_smaller_one_can_be_seen(detectable, least, most):
    """Detectable: the smaller effect's size beside the other one and the base, over 2.487 standard deviations."""
    world, rng = World(6), np.random.default_rng(7)
    given = np.vstack([world.signatures[4], world.jacobian * 1.0])
    apart = world.signatures[5] - np.linalg.lstsq(given.T, world.signatures[5], rcond=None)[0] @ given
    size = 2.487 * detectable / float(np.linalg.norm(apart))
    found = 0
    for _ in range(60):
        amplitudes = np.zeros(8)
        amplitudes[4], amplitudes[5] = 3 * size, size * rng.choice([-1, 1])
        mass = world.posterior(world.residual(rng, amplitudes))
        found += set(world.every[int(np.argmax(mass))]) == {"e", "f"}
    assert least <= found / 60 <= most


def test_the_size_of_the_discrepancy_is_summed_out_with_its_prior():
    scales = np.log(np.geomspace(1e-4, 1e-2, 41))
    flat = summed_out(np.full((2, 41), -3.0), scales, 1e-3, 0.5)
    assert flat == pytest.approx([-3.0, -3.0])
    peaked = np.where(np.arange(41) == 30, 0.0, -1e3)
    near, far = (float(summed_out(peaked[None], scales, np.exp(scales[k]), 0.5)[0]) for k in (30, 20))
    assert near - far == pytest.approx(0.5 * ((scales[30] - scales[20]) / 0.5) ** 2, abs=0.05)
