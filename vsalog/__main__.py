"""`python -m vsalog` is `vsalog`."""

from vsalog.cli import main

main()
