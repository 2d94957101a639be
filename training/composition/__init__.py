"""Composition while training: samples whose parts come from several clips."""
