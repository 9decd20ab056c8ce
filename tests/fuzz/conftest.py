"""The targets take their seeds from what the readers' tests write."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent.parent / "readers"))
