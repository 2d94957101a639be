"""File formats of a take: readers and writers."""
