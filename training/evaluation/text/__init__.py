"""Does the motion do what the words say."""
