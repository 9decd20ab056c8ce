"""What of a log is looked at, and how much: limits that several readers share."""

PIECE_BYTES = 2**20
"""Bytes of a file that are read at once: enough that calls cost nothing, few enough for memory and the processor's cache."""

GLANCE_BYTES = 2**16
"""Bytes of the beginning or end of a file, chunk, record or line that are looked at: no header, name or row is as long."""

PACKED_BYTES = 16 * 2**20
"""Messages of so many bytes, or `BLOCK_ROWS` of them, that come one by one make a packet or a block. What unfolds to less is no
bomb, and a line that is longer has no end."""

BLOCK_ROWS = 8192
"""Samples a block has at most: large enough for NumPy, small enough that a log never sits in memory."""

MAX_DEPTH = 32
"""Structures within structures that are followed; messages of robots have fewer than ten, and damage has no end."""

MAX_ARRAY = 64
"""Elements of an array, or names in a column, that tell parts of a machine apart; more are images, clouds, maps or counters."""

MOST_PARTS = 256
"""Parts of a stream or table (devices, frames, patterns of blanks) that are told apart; more are a counter's values."""

MOST_STEPS = 2**18
"""Parts of a message, or records of a file, that Python walks one by one, in a second or so."""

SAMPLE_ROWS = 200
"""Rows of a table that tell what its columns are."""

MOST_LINES = 32
"""Lines of a header, and rows of values ahead of it, at most."""

ENOUGH = 8
"""Samples, rows or values that show a pattern if all do: by chance, one in 256 times."""

TELLING = 0.9
"""Fraction of rows for which a rule must hold; damage and exceptions are in fewer than the others."""

SHOWN = 3
"""Names or places that a finding lists; of more it tells the number."""
