"""A user study (Sec. IV-D): films of several methods rated blind, and the statistics of the answers."""
