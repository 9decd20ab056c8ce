"""CSV, TSV and other tables of text."""
