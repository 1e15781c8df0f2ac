"""The workstation: simulate cloth, fit it to takes and diagnose what the simulation still gets wrong."""

import os as _os

# Taichi prints a banner to stdout when it is first imported, which would spoil piped output.
_os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
