"""Prompts expanded by a language model."""
