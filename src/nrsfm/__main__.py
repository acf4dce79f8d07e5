"""``python -m nrsfm`` is the command ``nrsfm``."""

import sys

from nrsfm.harness.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
