"""Edits of the shown pose: what a prompt asks for and the network's motion lacks. They are not fed back to the network."""
