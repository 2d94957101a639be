"""Films and contact sheets drawn from files."""
