"""One module for each command of `sport`: `add` declares its arguments, `run` does what they ask for."""
