"""A simple, slow decoder for the depth images of `firmware_host.oni_depth_codec`."""

from __future__ import annotations

import struct

import numpy as np

from formats.arrays import Unsigned


def decode_depth(data: bytes, shape: tuple[int, int]) -> Unsigned:
    """Expand a compressed depth image.

    Raises:
        ValueError: the data is truncated or does not fill `shape`.
    """
    try:
        (table_size,) = struct.unpack_from("<H", data, 0)
        table = np.frombuffer(data, "<u2", table_size, 2)
        at = 2 + 2 * table_size
        (place,) = struct.unpack_from("<H", data, at)
        places = [place]
        at += 2
        while at < len(data):
            byte = data[at]
            at += 1
            if 0xE0 < byte < 0xFF:
                places += [place] * (2 * (byte - 0xE0))
                continue
            low = 0xF
            if byte < 0xE0:
                place -= (byte >> 4) - 6
                places.append(place)
                low = byte & 0xF
            if low == 0xF:
                is_short = data[at] & 0x80
                place = place - (data[at] - 192) if is_short else (data[at] << 8) | data[at + 1]
                at += 1 if is_short else 2
                places.append(place)
            elif low != 0xD:
                place -= low - 6
                places.append(place)
        return np.asarray(table[np.array(places)].reshape(shape))
    except (IndexError, struct.error) as error:
        raise ValueError("the compressed depth image is cut off or damaged") from error
