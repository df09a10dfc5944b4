"""What to go on with where no effect of the catalogue fits: hints and stopgaps, named as such."""
