"""The blind check: cases of a generator that shares no code with the diagnosis, sealed labels, and a score."""
