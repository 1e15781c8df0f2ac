"""The tree of proposals that one batch evaluates ahead, node by node."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.speculation import grow


def tree(width, depth, chances, *, is_started=True):
    """Each node's candidate, whose decimal digits are the accepted iterations, and the nodes that follow it."""
    nodes = grow(
        np.zeros(1), width, depth=depth, is_started=is_started,
        propose=lambda theta, offset: theta + 10.0**offset, acceptance=lambda offset: chances[offset],
    )  # fmt: skip
    return [(round(node.candidate[0]), node.if_accepted, node.if_rejected) for node in nodes]


# Reached with 1, 0.6, 0.6 x 0.7, 0.4, 0.4 x 0.7, 0.6 x 0.3 and 0.4 x 0.3.
CHANCES = (0.6, 0.3)
WHOLE = [(1, 1, 3), (11, 5, 2), (101, None, None), (10, 6, 4), (100, None, None), (111, None, None), (110, None, None)]


@pytest.mark.parametrize("width", [7, 20])
def test_the_likeliest_node_comes_next(width):
    assert tree(width, 3, CHANCES) == WHOLE


def test_a_narrow_batch_has_the_likeliest_nodes():
    assert tree(4, 3, CHANCES) == [(1, 1, 3), (11, None, 2), (101, None, None), (10, None, None)]


def test_before_the_start_the_start_is_first_and_its_node_follows_as_if_accepted():
    def later(node):
        return None if node is None else node + 1

    after = [(candidate, later(accepted), later(rejected)) for candidate, accepted, rejected in WHOLE]
    assert tree(20, 3, CHANCES, is_started=False) == [(0, 1, None), *after]
    nodes = grow(np.ones(1), 2, depth=1, is_started=False, propose=lambda theta, _: theta, acceptance=lambda _: 0.5)
    assert [node.is_start for node in nodes] == [True, False]


@pytest.mark.parametrize(("depth", "nodes"), [(0, []), (1, [1]), (2, [1, 11, 10])])
def test_a_tree_is_as_deep_as_the_iterations_that_are_left(depth, nodes):
    assert [candidate for candidate, *_ in tree(9, depth, (0.6,))] == nodes
    assert [candidate for candidate, *_ in tree(9, depth, (0.6,), is_started=False)] == [0, *nodes]


def test_nodes_that_are_equally_likely_come_as_they_arrive_the_rejection_first():
    assert [candidate for candidate, *_ in tree(9, 3, (0.5, 0.5))] == [1, 10, 11, 100, 110, 101, 111]
