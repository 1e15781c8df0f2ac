"""The 16zT codec: bytes computed by hand, and round trips."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_host.oni_depth_codec import encode_depth
from tests.firmware_host.oni_depth import decode_depth


def test_two_small_steps_share_one_byte() -> None:
    # Table 7 8 9, first place 0; steps 0 - 1 = -1 and 1 - 2 = -1 are the nibbles 5 and 5.
    assert encode_depth(np.array([[7, 8, 9]], np.uint16)) == bytes.fromhex("0300 0700 0800 0900 0000 55")


def test_a_last_single_step_is_closed_by_the_nibble_d() -> None:
    assert encode_depth(np.array([[7, 8]], np.uint16)) == bytes.fromhex("0200 0700 0800 0000 5d")


def test_thirty_unchanged_pixels_are_one_byte() -> None:
    # 1 pixel in the head, then 15 still pairs: 0xE0 + 15.
    assert encode_depth(np.full((1, 31), 500, np.uint16)) == bytes.fromhex("0100 f401 0000 ef")


def test_a_step_of_seven_is_written_in_full_behind_ff() -> None:
    image = np.array([[0, 1, 2, 3, 4, 5, 6, 7, 0]], np.uint16)
    # The last step is 7 - 0 = 7, too large for a nibble: the step before it shares its byte with the mark F.
    assert encode_depth(image)[-3:] == bytes([0x55, 0x5F, 192 + 7])


@pytest.mark.parametrize("largest", [2, 8, 20, 10_001, 65_536])
@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (3, 5), (7, 9), (64, 64)])
def test_every_pixel_comes_back_from_random_images(shape: tuple[int, int], largest: int) -> None:
    rng = np.random.default_rng(largest)
    for _ in range(5):
        image = rng.integers(0, largest, shape).astype(np.uint16)
        np.testing.assert_array_equal(decode_depth(encode_depth(image), shape), image)


def test_every_pixel_comes_back_from_smooth_images_with_runs() -> None:
    rng = np.random.default_rng(1)
    image = (np.cumsum(rng.integers(-1, 2, (60, 80)) * (rng.random((60, 80)) < 0.1), axis=1) + 900).astype(np.uint16)
    np.testing.assert_array_equal(decode_depth(encode_depth(image), image.shape), image)


def test_sensor_like_depth_shrinks_to_less_than_a_third() -> None:
    rng = np.random.default_rng(2)
    disparity = np.rint((27 + rng.normal(0, 0.05, (120, 160))) * 8) / 8
    image = np.rint(43185 / disparity).astype(np.uint16)
    assert len(encode_depth(image)) < image.nbytes / 3


def test_data_that_is_cut_off_is_refused() -> None:
    data = encode_depth(np.random.default_rng(3).integers(0, 5000, (8, 8)).astype(np.uint16))
    with pytest.raises(ValueError, match="cut off"):
        decode_depth(data[:-5], (8, 8))


def test_more_than_32768_distinct_values_are_refused() -> None:
    with pytest.raises(ValueError, match="32768"):
        encode_depth(np.arange(40_000, dtype=np.uint16))


def test_a_step_of_six_either_way_is_a_nibble() -> None:
    """Steps of -1 six times are the nibbles 5; 6 - 0 = 6 is the nibble 12, and 0 - 6 is the nibble 0."""
    image = np.array([[0, 1, 2, 3, 4, 5, 6, 0, 6]], np.uint16)
    assert encode_depth(image)[-4:] == bytes([0x55, 0x55, 0x55, 0xC0])
