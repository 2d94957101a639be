"""From a prompt to six body-part descriptions, their text embeddings and the content code Z^t (Sec. III-C)."""
