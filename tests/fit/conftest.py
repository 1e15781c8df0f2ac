"""Fixtures of all tests of `fit`."""

from __future__ import annotations

import contextlib

# SciPy reads and rewrites the docstrings of its 800 functions at import, which makes half a second in every process.
with contextlib.suppress(ImportError, AttributeError):
    from scipy._lib import _array_api

    _array_api.xp_capabilities = lambda **_: lambda function: function
