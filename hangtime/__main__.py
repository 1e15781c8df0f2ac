"""Run the `hangtime` command: `python -m hangtime`."""

from formats.start import main

main()
