"""Signals at any moment of any command: how it ends, how soon, and what it leaves."""
