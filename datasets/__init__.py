#: The group of entry points by which installed packages bring sources of datasets.
ENTRY_POINTS = "nrsfm.datasets"
