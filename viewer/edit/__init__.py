"""The tools that edit a take of the list or the live character: one file each, with handles, panel and edit."""
