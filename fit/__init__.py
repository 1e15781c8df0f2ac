"""The workstation: cloth simulation, parameter fits to takes, and diagnosis of the remaining model-form error."""

import os as _os
import pwd as _pwd

# Taichi's first import would print to stdout and spoil piped output. It prints a banner. If stdout is not the
# console's, it also reports a graphical shell.
_os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
_os.environ.setdefault("TI_ENABLE_PYBUF", "0")
# Its import ends the process if no home folder is known. In a container a user may be a number without a name and home.
if "HOME" not in _os.environ:
    try:
        _os.environ["HOME"] = _pwd.getpwuid(_os.getuid()).pw_dir
    except KeyError:
        _os.environ["HOME"] = "/nonexistent"
