"""Sessions that are damaged, large or hostile, in numbers: `python -m tests.damage`. The suite has a small share of each."""
