"""The open session: its edits, undo and redo, and its file."""
