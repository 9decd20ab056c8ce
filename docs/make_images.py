"""Make the pictures of the documentation by the commands of the pages that show them: ``python -m docs.make_images``."""

import os
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

import snippets  # noqa: E402


def main() -> None:
    """Run the pages that have pictures, and copy these."""
    os.environ["MPLBACKEND"] = "agg"
    for page in map(snippets.read, (HERE.parent / "README.md", *sorted(HERE.rglob("*.md")))):
        if page.images:
            with tempfile.TemporaryDirectory() as folder:
                os.chdir(folder)
                snippets.run(page, page.steps, Path(folder))
                for image, source in page.images.items():
                    shutil.copy(Path(folder, source), HERE / "images" / image)


if __name__ == "__main__":
    main()
