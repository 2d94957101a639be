"""The session that is open: its edits, undo and redo, and its file."""
