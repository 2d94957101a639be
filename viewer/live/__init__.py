"""The live link: poses go to other programs as UDP messages."""
