"""What goes over the fence: takes, rigs, garments, fit results and diagnoses, and how they are read and written."""
