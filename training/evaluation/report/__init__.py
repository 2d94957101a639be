"""Tables, bars and figures of an evaluation."""
