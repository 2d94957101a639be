"""The stages of training: phases, content encoder, longer sentences, motion."""
