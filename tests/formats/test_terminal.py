"""Messages of a command."""

from __future__ import annotations

import os
import subprocess
import sys


def test_a_message_and_the_end_of_its_line_are_written_in_one_piece():
    """Packets keep writes apart, and an unbuffered stream passes each write on."""
    from socket import AF_UNIX, SOCK_SEQPACKET, socketpair

    ours, theirs = socketpair(AF_UNIX, SOCK_SEQPACKET)
    with ours, theirs:
        said = "from formats.terminal import say; say('camera 40 %')"
        words = [sys.executable, "-u", "-c", said]
        subprocess.run(words, stderr=theirs, check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
        assert ours.recv(100) == b"camera 40 %\n"
