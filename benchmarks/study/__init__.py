"""User study (Sec. IV-D): blind ratings of films of several methods, and their statistics."""
