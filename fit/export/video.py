"""Encoding of moving cloth as a film: MP4 and WebM by PyAV, GIF by Pillow."""

from __future__ import annotations

import io
from collections.abc import Callable
from fractions import Fraction

from fit.errors import FitError
from fit.export.drawing import Stage
from fit.export.moving import Moving

Progress = Callable[[int, int], None]

CODECS = {".mp4": ("libx264", "libsvtav1", "mpeg4"), ".webm": ("libvpx-vp9", "libsvtav1", "libvpx")}
FILMS = (*CODECS, ".gif")  # endings
GIF_RATE = 20.0  # frames a second at most: browsers slow down frames shorter than 20 ms, and GIF counts in 10 ms
DEFAULT_SIZE = (960, 720)  # px; our choice: 4 to 3, in which a hanging garment fills the picture; less would hide folds


def film(
    moving: Moving, suffix: str, remark: str, size: tuple[int, int] = DEFAULT_SIZE, progress: Progress | None = None
) -> bytes:
    """Return a film of the motion in the format of a suffix, with `remark` in its metadata.

    Raises:
        ModuleNotFoundError: Pillow or PyAV is not installed.
        FitError: PyAV has no encoder for the format.
    """
    show = progress or (lambda done, total: None)
    return _gif(moving, remark, size, show) if suffix == ".gif" else _av(moving, suffix, remark, size, show)


def _av(moving: Moving, suffix: str, remark: str, size: tuple[int, int], show: Progress) -> bytes:
    import av

    even = moving.even()
    codec = next((c for c in CODECS[suffix] if c in av.codecs_available), None)
    if codec is None:
        raise FitError(f"PyAV has no encoder for {suffix}", where="--out", advice="write a .gif instead")
    out = io.BytesIO()
    with av.open(out, "w", format=suffix[1:]) as container:
        container.metadata["comment"] = remark
        stream = container.add_stream(codec, rate=Fraction(even.rate).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        if codec == "libx264":
            stream.options = {"crf": "18"}
        elif codec.startswith("libvpx"):
            stream.options = {"crf": "28", "b:v": "0", "deadline": "good", "cpu-used": "5"}
        for number, picture in enumerate(Stage(even, size).pictures()):
            container.mux(stream.encode(av.VideoFrame.from_image(picture)))
            show(number + 1, len(even.time))
        container.mux(stream.encode())
    return out.getvalue()


def _gif(moving: Moving, remark: str, size: tuple[int, int], show: Progress) -> bytes:
    even = moving.even(min(GIF_RATE, moving.rate))
    shots = []
    for number, picture in enumerate(Stage(even, size).pictures()):
        shots.append(picture.quantize(64))
        show(number + 1, len(even.time))
    out = io.BytesIO()
    shots[0].save(
        out, "GIF", save_all=True, append_images=shots[1:], duration=round(100 / even.rate) * 10, loop=0,
        comment=remark.encode(),
    )  # fmt: skip
    return out.getvalue()
