"""Contact sheets drawn from files."""
