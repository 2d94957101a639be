"""Projects: everything one works on in one file, read with doubt."""
