"""A session as a value (takes, ground, character and prompt), its history, and its file."""
