"""Choose the future proposals of a sequential chain that one batch evaluates before their predecessors are decided.

Iteration t+1 starts from one of two candidates, depending on whether iteration t was accepted; so the later proposals
form a binary tree. The chain reaches a node with the product of the guessed probabilities along the node's path. A
batch advances the chain by the number of its nodes on the true path. The expected advance is the sum of the nodes'
probabilities. A child is never likelier than its parent. Taking the likeliest node again and again therefore gives the
tree of the greatest expected advance. Without acceptances the tree is a line of rejections. With a probability of one
half the tree is full.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

from formats.arrays import Floats


@dataclass
class Branch:
    """A node of the tree: its candidate, and the batch index of the node after acceptance and after rejection."""

    candidate: Floats
    is_start: bool = False
    if_accepted: int | None = None
    if_rejected: int | None = None


def grow(
    current: Floats,
    width: int,
    *,
    depth: int,
    is_started: bool,
    propose: Callable[[Floats, int], Floats],
    acceptance: Callable[[int], float],
) -> list[Branch]:
    """Return the up to `width` most probable nodes of the tree, most probable first, at most `depth` iterations deep.

    `propose(theta, offset)` makes the candidate of the iteration `offset` after the next from theta,
    (parameters,); `acceptance(offset)` guesses the probability that it is accepted. Before the start, theta
    itself comes first.
    """
    nodes: list[Branch] = []
    # (-reach probability, order of arrival, parent, whether accepted there, theta, offset)
    waiting: list[tuple[float, int, int | None, bool, Floats, int]] = []
    arrivals = 0
    if is_started:
        if depth > 0:
            waiting.append((-1.0, 0, None, False, current, 0))
    else:
        nodes.append(Branch(current.copy(), is_start=True))
        if depth > 0:
            waiting.append((-1.0, 0, 0, True, current, 0))
    while waiting and len(nodes) < width:
        negative_reach, _, parent, was_accepted, theta, offset = heapq.heappop(waiting)
        index = len(nodes)
        if parent is not None:
            if was_accepted:
                nodes[parent].if_accepted = index
            else:
                nodes[parent].if_rejected = index
        candidate = propose(theta, offset)
        nodes.append(Branch(candidate))
        if offset + 1 < depth:
            accepted = acceptance(offset)
            arrivals += 2
            heapq.heappush(waiting, (negative_reach * (1 - accepted), arrivals - 1, index, False, theta, offset + 1))
            heapq.heappush(waiting, (negative_reach * accepted, arrivals, index, True, candidate, offset + 1))
    return nodes
