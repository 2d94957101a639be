"""The session on disk: one SQLite file that is project, autosave and recovery at once."""
