"""Sync: a process of its own that brings kept takes to the server, verifies them there and proves it every week."""
