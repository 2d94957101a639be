"""Prompts in the viewer: requests, answers, and their panels."""
