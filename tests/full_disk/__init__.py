"""Exports, films and sessions onto a disk that gets full: a sentence, nothing left, the old file kept."""
