"""The files that machines exchange, read and written: takes, rigs, garments, fit results and diagnoses."""
