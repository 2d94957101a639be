"""Speed, memory and endurance of the installed program, one command each."""
