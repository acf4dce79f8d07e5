#: The group of entry points by which installed packages bring methods.
ENTRY_POINTS = "nrsfm.methods"
