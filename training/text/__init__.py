"""Text side of training: export of the text encoder, measured captions of motion, embeddings of the prompt library."""
