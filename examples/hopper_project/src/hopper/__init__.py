"""The leg of a hopper on its stand: its model, its drives, and an effect of its motors."""
