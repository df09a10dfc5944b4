"""What a gap means for a policy: which of the named effects breaks it."""
