"""`hangtime sensor doctor`: go through everything that a recording needs, and say what to do where it fails."""
