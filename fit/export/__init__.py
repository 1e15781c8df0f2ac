"""What people take away: a fit as files for other programs."""
