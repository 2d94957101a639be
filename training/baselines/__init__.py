"""Other methods on the same data, with the interface of our models: what the paper's Table I compares with."""
