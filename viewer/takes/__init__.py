"""Takes in the viewer: recording, playback, export and their panels."""
