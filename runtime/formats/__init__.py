"""File formats of a take: what is read and what is written."""
