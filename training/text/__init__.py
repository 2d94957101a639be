"""Words for training: the text encoder's export, measured captions of motion, and the prompt library's embeddings."""
