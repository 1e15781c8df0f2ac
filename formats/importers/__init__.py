"""Other people's recordings, turned into takes."""
