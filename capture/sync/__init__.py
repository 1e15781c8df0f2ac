"""Sync: a separate process that uploads kept takes, verifies them on the server and proves one copy every week."""
