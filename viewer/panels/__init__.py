"""The panels: each file draws one, reads the state and calls actions; nothing here knows about motion."""
