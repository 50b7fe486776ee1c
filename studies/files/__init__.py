"""What files are read and refused with: checked records, units in the names of keys, errors of one line."""
