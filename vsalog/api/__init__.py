"""What `import vsalog` offers: a function per command, and what each returns."""
