"""A walking figure that wears a fitted skirt or T-shirt."""
