"""Models with their recordings, and which of these are held out."""
