"""Prompts in the viewer: what is asked for, who answers, and their panels."""
