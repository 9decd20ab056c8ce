"""Whether a test notices when a limit changes: `make limits` doubles and halves each number that a module of vsalog names.

`constants` finds them, `record` notes once which test runs which module, `run` changes and tests copies of the package.
"""
