"""What was found, as results, as text, as figures and as files."""
