"""Prompts without a language model: an English grammar and the shipped library."""
