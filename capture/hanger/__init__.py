"""Find the hanger's two markers in a frame, follow them, and give the hanger's pose."""
