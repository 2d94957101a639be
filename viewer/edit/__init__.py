"""Editing tools for a listed take or the live character, one file each, with handles, panel and edits."""
