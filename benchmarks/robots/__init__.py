"""Robot files as other people have them, and what walkerkit has to make of each."""
