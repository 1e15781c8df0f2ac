"""The workstation: simulate cloth, fit it to takes and diagnose what the simulation still gets wrong."""

import os as _os
import pwd as _pwd

# Taichi would print to stdout when it is first imported, which spoils piped output: a banner, and, where stdout is not
# the console's, that it believes itself in a graphical shell.
_os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
_os.environ.setdefault("TI_ENABLE_PYBUF", "0")
# Its import ends the process where nobody says where home is; a number without a name, as in a container, has none.
if "HOME" not in _os.environ:
    try:
        _os.environ["HOME"] = _pwd.getpwuid(_os.getuid()).pw_dir
    except KeyError:
        _os.environ["HOME"] = "/nonexistent"
