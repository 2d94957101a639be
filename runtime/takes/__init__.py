"""Takes on their way out: what is exported, in which form, and on which ground."""
