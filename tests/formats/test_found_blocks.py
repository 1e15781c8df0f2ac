"""Blocks of zeros and stale blocks, by their indices."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers.c3d_blocks import find_blocks

WIDTH = 80  # bytes of a frame: no multiple of a block
RNG = np.random.default_rng(0)
BLOCKS = [RNG.bytes(512) for _ in range(8)]
ZEROS = bytes(512)


def found(tmp_path, raw, size=None, begin=0):
    (tmp_path / "a").write_bytes(raw)
    blocks = find_blocks(tmp_path / "a", begin, len(raw) - begin if size is None else size, WIDTH)
    return blocks.of_zeros.tolist(), blocks.between.tolist(), blocks.stale.tolist()


def test_two_blocks_of_zeros_repeat_no_block(tmp_path):
    assert found(tmp_path, BLOCKS[0] + ZEROS + BLOCKS[1] + ZEROS + BLOCKS[2]) == ([1, 3], [1, 3], [])


def test_stale_blocks_are_in_the_order_of_the_file_whatever_their_bytes(tmp_path):
    for order in ((0, 1), (1, 0), (2, 3), (3, 2), (4, 5), (5, 4)):
        one, other = (BLOCKS[k] for k in order)
        assert found(tmp_path, one + other + BLOCKS[6] + one + other) == ([], [], [3, 4])


def test_a_block_of_the_same_words_in_another_order_is_not_stale(tmp_path):
    words = np.frombuffer(BLOCKS[0], np.uint64)
    for turned in (words[::-1], np.roll(words, 1), words[np.r_[1, 0, 2:64]]):
        assert found(tmp_path, BLOCKS[0] + BLOCKS[1] + turned.tobytes()) == ([], [], [])


@pytest.mark.parametrize("size", [1024 + 1, 1024 + 511])
def test_bytes_behind_the_frames_belong_to_no_block(tmp_path, size):
    raw = BLOCKS[0] + BLOCKS[1] + bytes(size - 1024) + b"\1" * 600
    assert found(tmp_path, raw, size) == ([2], [], [])
    assert found(tmp_path, b"\1" * 512 + raw, size, begin=512) == ([2], [], [])
