"""Edits of the shown pose: what words ask for and the network's own motion lacks. The network never sees them."""
