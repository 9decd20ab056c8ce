"""The API of `import vsalog`: a function per command, and its result."""
