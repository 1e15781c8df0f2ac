"""Run the `hangtime` command: `python -m hangtime`."""

from formats.command import main

main()
