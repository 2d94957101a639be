"""Other methods of the paper's Table I, trained on the same data, with the interface of our models."""
