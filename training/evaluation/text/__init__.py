"""Evaluation of prompt adherence: whether motion does what the words say."""
