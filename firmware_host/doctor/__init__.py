"""`hangtime sensor doctor`: check each requirement of a recording, and advise on each failure."""
