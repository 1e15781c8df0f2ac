"""A walking figure that wears a fitted skirt."""
