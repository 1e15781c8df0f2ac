"""The refusal of a folder where recordings are expected, with the next step for the files in it.

An import takes no folder, since its files may be of several garments, units and axes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from formats.errors import TakeError
from formats.plain_text import as_typed, joined


def refuse_folder(path: Path, endings: Sequence[str]) -> None:
    """Refuse a folder; a shell's pattern names its files that can be read.

    endings: of files that can be read, in lower case

    Raises:
        TakeError: the path is a folder.
    """
    if not os.path.isdir(path):
        return
    try:
        found = sorted({Path(name).suffix for name in os.listdir(path)})
    except OSError:  # a folder that cannot be listed may still hold files to name
        raise TakeError("is a folder", where=path, advice="give the files in it") from None
    shown = as_typed([str(path)])
    if readable := [ending for ending in found if ending.lower() in endings]:
        patterns = " ".join(f"{shown}/*{ending}" for ending in readable)
        raise TakeError("is a folder", where=path, advice=f"give the files in it, as in {patterns}")
    if ".mcap" in found:
        raise TakeError("is a folder of takes", where=path, advice=f"`hangtime takes list {shown}` lists them")
    raise TakeError(f"is a folder without {joined(endings, 'or')}", where=path, advice="give files of recordings")
